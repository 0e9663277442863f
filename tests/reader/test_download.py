"""What somebody who has only downloaded a release does with it in Python."""

import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import kb
from kb.core.errors import KbError, MissingExtra, UsageError


@pytest.mark.parametrize("name", ["youtube_videos", "pairs", "links", "reddit_posts"])
def test_tables_and_answers_iterate_slice_and_show_themselves(release: Path, name: str) -> None:
    data = kb.load(release)
    whole = data[name].to_pylist()
    for rows in (data[name], data.sql(f"FROM {name}")):
        assert rows.columns == rows.schema.names
        assert [*rows] == whole
        assert rows[0] == whole[0]
        assert rows[-1] == whole[-1]
        assert rows[2:9:3].to_pylist() == whole[2:9:3]
        assert rows[::-1].to_pylist() == whole[::-1]
        assert rows[:0].to_pylist() == []
        with pytest.raises(IndexError):
            rows[len(whole)]
        first = rows.columns[0]
        assert rows[first].to_pylist() == [row[first] for row in whole]
        printed = repr(rows)
        assert str(whole[0][first]) in printed
        assert f"{len(whole):,} rows" in printed
        assert max(map(len, printed.splitlines()[1:])) <= 80
        assert "<table>" in rows._repr_html_()


def test_no_column_of_clips_comes_twice(release: Path) -> None:
    clips = kb.load(release).clips(None)
    assert not [name for name in clips.columns if re.search(r"_\d+$", name)]
    assert {"duplicate_of", "language", "words_per_second"} <= {*clips.columns}


def test_a_video_with_all_that_names_it(release: Path, root: Path) -> None:
    data = kb.load(release)
    video_id = data["pairs"][0]["video_id"]
    video = data.video(video_id)
    assert video.row in data["youtube_videos"]
    assert video.transcript is None
    assert {row["video_id"] for row in video.pairs} == {video_id}
    assert len(video.pairs) == sum(row["video_id"] == video_id for row in data["pairs"])
    assert video.links.columns == data["links"].columns
    assert {row["video_id"] for row in video.links} == {video_id}
    assert video_id in repr(video)
    assert video_id in video._repr_html_()
    cues = kb.load(root).video(video_id).transcript
    assert cues
    assert cues[0]["text"]
    alone = kb.load(release / "youtube").video(video_id)
    assert len(alone.pairs) == len(alone.tasks) == len(alone.links) == 0
    with pytest.raises(UsageError, match="unknown video 'nope'"):
        data.video("nope")
    with pytest.raises(UsageError, match="no videos"):
        kb.load(release / "pairs").video(video_id)


def test_rows_for_hugging_face(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = kb.load(release)["pairs"]
    rows = pairs.to_hf(["pair_id", "keyword"])
    assert rows.num_rows == len(pairs)
    assert rows[3]["pair_id"] == pairs[3]["pair_id"]
    monkeypatch.setattr("kb.reader.tables.find_spec", lambda _: None)
    with pytest.raises(MissingExtra, match="datasets is not installed"):
        pairs.to_hf()


def test_ids_with_nulls_stay_integers_in_pandas(release: Path) -> None:
    entities = kb.load(release)["entities"]
    frame = entities.to_pandas()
    assert str(frame["wiki_page_id"].dtype) == "Int64"
    assert frame["wiki_page_id"].isna().any()
    known = [row["wiki_page_id"] for row in entities if row["wiki_page_id"] is not None]
    assert frame["wiki_page_id"].dropna().tolist() == known


WRONG = {
    "sql": "data.sql('FROM nix')",
    "column": "data.sql('SELECT nix FROM pairs')",
    "condition": "data.clips(None, 'nix = 3')",
    "search": "data.search('')",
    "folder": "kb.load('nowhere at all')",
    "above": "kb.load('..')",
    "table": "data['nix']",
}


@pytest.mark.parametrize("code", WRONG.values(), ids=[*WRONG])
def test_hints_are_python(
    release: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: str
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    with pytest.raises(KbError) as raised:
        eval(code, {"kb": kb, "data": kb.load(release)})
    assert raised.value.__notes__ == [raised.value.hint]
    assert not re.search(r"kb (query|search)|--\w", raised.value.hint), raised.value.hint


@pytest.mark.parametrize("code", ["1 / 0", WRONG["sql"], "sys.exit(3)", "data.sql('FROM pairs')"])
def test_nothing_is_printed_when_python_ends(release: Path, code: str) -> None:
    """Tables, answers and a connection are still there then."""
    start = f"import kb, sys; data = kb.load({str(release)!r}); kept = data.sql('FROM pairs'); "
    done = subprocess.run(
        [sys.executable, "-c", f"{start}reader = data._opened.con.sql('FROM pairs'); {code}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "nanobind" not in done.stderr
    assert done.returncode == {"1 / 0": 1, WRONG["sql"]: 1, "sys.exit(3)": 3}.get(code, 0)


def test_pyarrow_reads_what_the_reader_reads(release: Path) -> None:
    """The reader adds nothing to a table and leaves nothing out."""
    (shard,) = (release / "pairs").glob("quality-*.parquet")
    assert kb.load(release)["pairs_quality"].to_arrow().equals(pq.read_table(shard))
