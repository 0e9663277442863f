"""What workers do for a bucket."""

from pathlib import Path

import pytest

from kb.filters.filter_run import run_clean
from kb.store.tables import partition
from tests.filters.made import (
    run_at,
)
from tests.filters.test_chain import MINE

ONCE = """

made = clean


def clean(p):
    spec = made(p)

    def assemble(newest):
        ids = newest["videos"]["video_id"].to_pylist() if "videos" in newest else []
        with open(Path(__file__).with_name("assembled.txt"), "a") as file:
            file.writelines(f"{key}\\n" for key in ids)
        return spec.assemble(newest)

    return replace(spec, assemble=assemble)
"""


@pytest.mark.parametrize("size", [8 << 20, 64], ids=["one bucket", "many buckets"])
def test_a_bucket_is_joined_once_for_texts_and_for_judging(
    root: Path, tmp_path: Path, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(partition, "RAW_BYTES", size)
    mine = tmp_path / "mine.py"
    mine.write_text(MINE + ONCE)
    run_clean(run_at(root, workers=1, pipeline=mine), "youtube")
    assembled = (tmp_path / "assembled.txt").read_text().split()
    assert "kept" in assembled
    assert len(assembled) == len(set(assembled))
    assert not list((root / "clean").glob(".*"))  # nor is anything left of what was kept for it
