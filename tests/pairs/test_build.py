"""`kb pairs` on a data root: the same bytes however the work is cut, resumed and refilled."""

import sys
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import manifest
from kb.artifacts.makers import make_and_export
from kb.artifacts.measures import read_measures, write_measure
from kb.core.context import Run
from kb.core.errors import FatalError, ProfileError, SettingError
from kb.core.progress import LineProgress
from kb.pairs import build as building
from kb.pairs.restore import refill
from kb.store.layout import Layout
from tests.pairs.made import PHRASES, fill, shards, tables


def _bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.parquet"))}


def test_the_whole_job(run: Run) -> None:
    summary = make_and_export(run, "pairs")
    rows = pq.read_table(shards(run.root / "pairs"))
    assert summary["videos"] == 60
    assert summary["pairs"] == rows.num_rows > 100
    assert (
        rows["pair_id"].to_pylist()
        == rows.sort_by(
            [("video_id", "ascending"), ("clip_start_s", "ascending"), ("pair_id", "ascending")]
        )["pair_id"].to_pylist()
    )
    assert len(set(rows["pair_id"].to_pylist())) == rows.num_rows
    released = pq.read_table(shards(run.root / "release" / "pairs"))
    assert "text" not in released.column_names
    assert released.equals(rows.drop_columns("text").cast(released.schema), check_metadata=False)
    made = manifest.read_manifest(run.root, "pairs")
    assert made is not None
    counts = made.figures["keywords"]
    assert sum(hits["matches"] for hits in counts.values()) == summary["matches"]
    assert not list(run.root.glob("pairs/.*"))


def test_transcripts_that_a_killed_filter_had_moved_away_come_back(run: Run) -> None:
    clean = Layout(run.root).clean("youtube")
    clean.rename(clean.with_name(".youtube.old"))  # killed between the two renames
    assert make_and_export(run, "pairs")["videos"] == 60
    assert clean.is_dir()


def test_workers_cuts_and_file_layout_change_no_byte(
    run: Run, data, make_rows, monkeypatch
) -> None:
    make_and_export(run, "pairs")
    first = _bytes(run.root / "pairs") | {"released": _bytes(run.root / "release" / "pairs")}
    other = replace(run, root=run.root.with_name("other"), workers=2)
    fill(other.root, *data, make_rows, files=3)
    monkeypatch.setattr(building, "_ROWS", 7)
    make_and_export(other, "pairs")
    assert (
        _bytes(other.root / "pairs") | {"released": _bytes(other.root / "release" / "pairs")}
        == first
    )


def test_made_pairs_are_not_made_again_until_something_changes(run: Run, monkeypatch) -> None:
    made = make_and_export(run, "pairs")

    def fail(*_: object) -> None:
        raise AssertionError("worked again")

    with monkeypatch.context() as patch:
        patch.setattr(building, "make_part", fail)
        assert make_and_export(run, "pairs", "minedojo")["pairs"] == made["pairs"]
    section = run.profile.pairs.model_copy(update={"max_pairs_per_video": 2})
    fewer = make_and_export(
        replace(run, profile=run.profile.model_copy(update={"pairs": section})), "pairs"
    )
    assert fewer["pairs"] <= 120 < made["pairs"]


def test_more_videos_change_no_pair(run: Run, make_rows) -> None:
    make_and_export(run, "pairs")
    before = pq.read_table(shards(run.root / "pairs")).to_pylist()
    more = replace(run, root=run.root.with_name("more"))
    for seed, place in ((0, more.root), (500, more.root.with_name("rest"))):
        fill(
            place,
            *tables(
                60 if not seed else 10,
                400,
                PHRASES,
                share=0.06,
                seed=seed,
            ),
            make_rows,
        )
    for table in ("transcripts", "videos"):
        (more.root.with_name("rest") / f"clean/youtube/{table}/part-00000.parquet").rename(
            more.root / f"clean/youtube/{table}/part-00009.parquet"
        )
    make_and_export(more, "pairs")
    after = {row["pair_id"]: row for row in pq.read_table(shards(more.root / "pairs")).to_pylist()}
    assert len(after) > len(before)
    assert all(after[row["pair_id"]] == row for row in before)


def test_transcripts_without_any_keyword_give_an_empty_index(run: Run, make_rows) -> None:
    none = replace(run, root=run.root.with_name("none"))
    fill(none.root, *tables(4, 60, ["xyzzy"]), make_rows)
    assert make_and_export(none, "pairs")["pairs"] == 0
    assert pq.read_table(shards(none.root / "pairs")).num_rows == 0


def test_measures_are_derived_again_from_what_is_kept(run: Run) -> None:
    make_and_export(run, "pairs")
    for section in ("labels", "speech_recognition"):  # of which nothing is kept here
        write_measure(run.root, section, {"n": 1})
    make_and_export(replace(run, again=True), "pairs")
    assert list(read_measures(run.root / "pairs")) == ["pairs"]


def test_a_released_index_is_filled_again(run: Run) -> None:
    make_and_export(run, "pairs")
    whole = _bytes(run.root / "pairs")
    index = run.root / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    summary = refill(run, index)
    assert (summary["missing"], summary["differing"]) == (0, 0)
    assert summary["filled"] == summary["pairs"]
    assert _bytes(run.root / "pairs") == whole


def test_texts_that_can_not_be_had_stay_null_and_are_counted(run: Run) -> None:
    make_and_export(run, "pairs")
    (run.root / "clean/youtube/transcripts/part-00001.parquet").unlink()
    summary = refill(run, run.root / "release" / "pairs")
    assert summary["missing"] == pq.read_table(shards(run.root / "pairs"))["text"].null_count > 0
    assert summary["filled"] + summary["missing"] == summary["pairs"]
    with pytest.raises(SettingError, match="no column 'pair_id'"):
        refill(run, run.root / "clean/youtube/videos/part-00000.parquet")
    with pytest.raises(SettingError, match="no index"):
        refill(run, run.root / "nowhere.parquet")


def test_without_transcripts_or_section(run: Run) -> None:
    with pytest.raises(FatalError, match="no transcripts"):
        make_and_export(replace(run, root=run.root / "empty"), "pairs")
    with pytest.raises(ProfileError, match=r"\[pairs\]"):
        make_and_export(
            replace(run, profile=run.profile.model_copy(update={"pairs": None})), "pairs"
        )


def test_videos_with_more_words_than_people_speak_are_counted_and_said(
    run: Run, data, make_rows, capsys: pytest.CaptureFixture[str]
) -> None:
    transcripts, lengths = data
    doubled, ids = lengths["video_id"][:3].to_pylist(), lengths["video_id"].to_pylist()
    short = pa.array(
        [
            seconds / 20 if video in doubled else seconds
            for video, seconds in zip(ids, lengths["duration_s"].to_pylist(), strict=True)
        ]
    )
    fill(run.root, transcripts, lengths.set_column(1, "duration_s", short), make_rows)
    run = replace(run, progress=LineProgress(sys.stderr))
    summary = make_and_export(run, "pairs")
    assert summary["fast_videos"] == 3
    assert "3 videos with more than 5.5 words a second" in capsys.readouterr().err
    rows = pq.read_table([*(run.root / "release/pairs").glob("quality-*.parquet")])
    rate = dict(
        zip(*(rows[n].to_pylist() for n in ("video_id", "video_words_per_second")), strict=True)
    )
    assert {video for video, words in rate.items() if words > 5.5} <= {*doubled}
    assert all(1 < words < 5.5 for video, words in rate.items() if video not in doubled)
