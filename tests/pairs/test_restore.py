"""Tests of `kb.pairs.restore`."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.core.config.pipeline import load, locate
from kb.core.context import Run
from kb.core.errors import SettingError
from tests.pairs.made import shards

pipeline = load(str(locate("pairs")))


def _bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


def test_a_released_index_is_filled_again(run: Run) -> None:
    pipeline.pairs(run, "parquet")
    whole = _bytes(run.root / "pairs")
    index = run.root / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    summary = pipeline.refill(run, index)
    assert (summary["missing"], summary["differing"]) == (0, 0)
    assert summary["filled"] == summary["pairs"]
    assert _bytes(run.root / "pairs") == whole


def test_texts_that_can_not_be_had_stay_null_and_are_counted(run: Run) -> None:
    pipeline.pairs(run, "parquet")
    (run.root / "clean/youtube/transcripts/part-00001.parquet").unlink()
    summary = pipeline.refill(run, run.root / "release" / "pairs")
    assert summary["missing"] == pq.read_table(shards(run.root / "pairs"))["text"].null_count > 0
    assert summary["filled"] + summary["missing"] == summary["pairs"]
    with pytest.raises(SettingError, match="no column 'pair_id'"):
        pipeline.refill(run, run.root / "clean/youtube/videos/part-00000.parquet")
    with pytest.raises(SettingError, match="no index"):
        pipeline.refill(run, run.root / "nowhere.parquet")
