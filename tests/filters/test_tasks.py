"""Tests of the steps of a row: the newest answers are joined, and written by bucket."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.pipeline import Recipe
from kb.core.config.profile import load_profile
from kb.core.errors import CountMismatch
from kb.core.progress import Progress, Task
from kb.core.sources import SOURCES
from kb.export import layouts
from kb.filters.filter_run import run_clean
from kb.schema import raw
from kb.store.state import tombstones
from kb.store.tables import partition
from tests.filters.made import (
    MONDAY,
    TUESDAY,
    digests,
    listing,
    put,
    rows,
    run_at,
    transcript,
    video,
)


def test_the_newest_answer_wins(root: Path) -> None:
    put(
        root,
        "videos",
        (TUESDAY, {"id": "kept,bare"}, listing(video("kept", statistics__viewCount="2000"))),
    )
    put(root, "videos", (MONDAY, {}, listing(video("kept", statistics__viewCount="7"))))
    put(root, "transcripts", (TUESDAY, {}, {"video_id": "kept", "outcome": "failed"}))
    summary = run_clean(run_at(root), "youtube")
    assert rows(root, "videos")["kept"]["view_count"] == 2000
    assert (
        rows(root, "videos")["kept"]["transcript_kind"] == "asr"
    )  # a later failure takes nothing away
    assert rows(root, "rejected")["bare"]["stage"] == "missing"  # it vanished since
    assert summary["duplicates"] == 4


def test_tombstones_are_left_out(root: Path) -> None:
    assert run_clean(run_at(root), "youtube")["crawled"] == 22
    tombstones.add_tombstones(root, "youtube", [("kept", "named"), ("few", "named")])
    summary = run_clean(run_at(root), "youtube")
    assert summary["crawled"] == 20
    assert "kept" not in rows(root, "videos")
    assert "kept" not in rows(root, "transcripts")
    assert "few" not in rows(root, "rejected")


def test_workers_segments_and_buckets_change_no_byte_of_the_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [f"v{number:04d}" for number in range(600)]
    answers = [
        listing(
            *(
                video(key, statistics__viewCount=str(int(key[1:]) * 3))
                for key in keys[start : start + 50]
            )
        )
        for start in range(0, 600, 50)
    ]
    said = [transcript(key) for key in keys]
    for name in ("one", "many"):
        step = 12 if name == "one" else 3
        for start in range(0, 12, step):
            put(
                tmp_path / name,
                "videos",
                *((MONDAY, {}, answer) for answer in answers[start : start + step]),
            )
        for start in range(0, 600, step * 50):
            put(tmp_path / name, "transcripts", *said[start : start + step * 50])
    run_clean(run_at(tmp_path / "one"), "youtube")
    monkeypatch.setattr(partition, "RAW_BYTES", 10_000)
    summary = run_clean(run_at(tmp_path / "many", workers=2), "youtube")
    assert summary["kept"] == 566
    assert len(list((tmp_path / "many/clean/youtube/videos").iterdir())) > 4
    for name in ("one", "many"):
        layouts.write_parquet(run_at(tmp_path / name), "youtube")
    assert digests(tmp_path / "one/release") == digests(tmp_path / "many/release")
    before = digests(tmp_path / "many/clean")
    run_clean(run_at(tmp_path / "many", workers=1), "youtube")
    assert digests(tmp_path / "many/clean") == before


def test_buckets_without_rows_are_no_failure_and_every_table_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "videos", (MONDAY, {}, listing(video("alone"))))
    monkeypatch.setattr(partition, "RAW_BYTES", 10)
    assert run_clean(run_at(tmp_path), "youtube")["pending"] == 1
    assert {path.name for path in (tmp_path / "clean/youtube").iterdir() if path.is_dir()} == {
        "videos",
        "transcripts",
        "playlists",
        "playlist_videos",
        "rejected",
        "failed",
        "pending",
    }
    assert list(rows(tmp_path, "pending")) == ["alone"]
    assert rows(tmp_path, "videos") == {}


class Harming(Progress):
    """Does `harm` between decoding and judging."""

    def __init__(self, harm: Callable[[], object]) -> None:
        self.harm = harm

    def task(self, name: str, *args: Any, **options: Any) -> Task:
        if name.startswith("filter "):
            self.harm()
        return super().task(name, *args, **options)


@pytest.mark.parametrize("kind", ["videos", "transcripts"])
def test_rows_of_a_bucket_that_is_gone_are_missed(root: Path, kind: str) -> None:
    """As for a worker that sees another folder under the data root's path."""
    run_clean(run_at(root), "youtube")
    before = digests(root / "clean")

    def harm() -> None:
        path, *_ = (root / "clean").glob(f".*/{kind}/0/*.arrow")
        path.unlink()

    with pytest.raises(CountMismatch, match="can be read"):
        run_clean(replace(run_at(root), progress=Harming(harm)), "youtube")
    assert digests(root / "clean") == before


def test_kinds_without_rows_of_their_own_are_declared() -> None:
    """By them alone a source has nothing to filter, and no build looks after it."""
    profile = load_profile("minecraft")
    for source in SOURCES.values():
        spread = Recipe(source.name).defined("clean")(profile).raw.kinds
        kinds = {kind.partition("/")[2] for kind in raw.kinds() if kind.startswith(source.name)}
        rowless = {kind for kind in kinds if kind not in spread or not spread[kind].bucket}
        assert rowless == {*source.unfiltered, *source.rowless}
