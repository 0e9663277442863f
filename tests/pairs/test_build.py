"""`kb pairs` on a data root: the same bytes however the work is cut, resumed and refilled."""

from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.artifacts import manifest
from kb.artifacts.makers import make_and_export
from kb.artifacts.measures import read_measures, write_measure
from kb.core.config.profile.products import Pairs
from kb.core.context import Run
from kb.core.errors import FatalError, ProfileError, SettingError
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
    made = manifest.read(run.root, "pairs")
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


def test_measures_stay_while_the_rules_of_the_pairs_do(run: Run) -> None:
    make_and_export(run, "pairs")
    write_measure(run.root, "one", {"n": 1})
    make_and_export(replace(run, again=True), "pairs")
    assert read_measures(run.root / "pairs")["one"] == {"n": 1}
    section = run.profile.section(Pairs).model_copy(update={"min_gap_s": 1.5})
    other = run.profile.model_copy(update={"pairs": section})
    make_and_export(replace(run, profile=other), "pairs")
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
