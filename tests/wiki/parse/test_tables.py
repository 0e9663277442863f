"""Tests of `kb.wiki.parse.tables`."""

from pathlib import Path
from typing import Any

import pytest
import zstandard

from kb.core.errors import DamagedData
from kb.wiki.parse import tables


def test_a_cycle_of_parents_contains_nothing() -> None:
    def entry(number: int, kind: str, parent: int | None) -> dict[str, Any]:
        text = f"t{number}"
        return {"id": number, "kind": kind, "parent": parent, "visible": True, "text": text}

    ring = [entry(1, "other", 2), entry(2, "other", 1), entry(3, "text", 1), entry(4, "text", 3)]
    assert tables.page_text(ring) == "t3"


@pytest.mark.parametrize("data", [None, b"", b"{}", zstandard.compress(b'{"page"')])
def test_an_unreadable_extraction_is_damage(tmp_path: Path, data: bytes | None) -> None:
    if data is not None:
        (tmp_path / "extraction.json.zst").write_bytes(data)
    with pytest.raises(DamagedData):
        tables.read_extraction(tmp_path, tmp_path)
