"""Tests of `kb.links.texts`."""

from pathlib import Path

import pytest

from kb.links import texts
from tests.links import made


def test_pieces_of_any_size_count_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Texts are looked through some megabytes at a time; what belongs to one thing stays whole."""
    blocks = ["an iron", "golem and a bed", "iron golem"]
    pages = [(f"Page {n}", blocks * (n % 4)) for n in range(9)]
    videos = [("Creeper", "x" * n, [(0, "oak log"), (2, "oak log")]) for n in range(5)]
    found = []
    for size in (1, 20, 1 << 20):
        monkeypatch.setattr(texts, "_BYTES", size)
        root = tmp_path / str(size) / "data"
        made.fill(root, videos, pages, [("t", "wolf", ["bed", "wolf"])], ["creeper"] * 3)
        made.links(made.run_at(root))
        found.append(made.rows(root))
    assert found[0] == found[1] == found[2]
    paged = [row for row in found[0] if row["part"] == "page"]
    counted = {(row["entity"], row["key"]): row["count"] for row in paged}
    assert counted["Iron Golem", "13"] == 3
    assert counted["Bed", "13"] == 3  # near the golem of the next block
