"""Export: released columns only, sorted, whole, and the same bytes whatever the clean parts."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from kb.core.errors import FatalError
from kb.export import layouts
from kb.export.rows import check_rows, json_list, sorted_rows
from kb.schema import table

TABLES = ("videos", "playlists", "playlist_videos")
FILES = {f"{name}-00000-of-00001.parquet" for name in TABLES}


def digests(folder: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.iterdir())
    }


def test_released_columns_only_and_never_transcripts(
    tmp_path: Path, make_rows, run_at, fill
) -> None:
    fill(tmp_path, "youtube/videos", make_rows("youtube/videos", 2500), 3)
    fill(tmp_path, "youtube/transcripts", make_rows("youtube/transcripts", 2500), 3)
    summary = layouts.write_parquet(run_at(tmp_path), "youtube")
    assert summary["videos"] == 2500
    folder = tmp_path / "release" / "youtube"
    assert {path.name for path in folder.iterdir()} == FILES
    read = duckdb.connect().sql(f"SELECT * FROM '{folder}/videos-*.parquet'").to_arrow_table()
    assert read.column_names == table("youtube/videos").names(released=True)
    assert not {"description", "tags", "channel_title"} & set(read.column_names)
    assert pc.all(pc.equal(read["video_id"], read["video_id"].combine_chunks().sort())).as_py()


def test_reddit_release_has_no_content(tmp_path: Path, make_rows, run_at, fill) -> None:
    fill(tmp_path, "reddit/posts", make_rows("reddit/posts", 10), 1)
    layouts.write_parquet(run_at(tmp_path), "reddit")
    for path in (tmp_path / "release" / "reddit").iterdir():
        names = set(pq.read_schema(path).names)
        assert not names & {"title", "body", "author_hash", "source_url", "poll_options"}
    assert (
        pq.read_metadata(tmp_path / "release/reddit/comments-00000-of-00001.parquet").num_rows == 0
    )


def test_the_same_bytes_whatever_the_parts_and_twice(
    tmp_path: Path, make_rows, run_at, fill
) -> None:
    rows = make_rows("youtube/videos", 3000)
    seen = []
    for name, parts in (("one", 1), ("many", 17)):
        fill(tmp_path / name, "youtube/videos", rows, parts)
        for _ in range(2):
            layouts.write_parquet(run_at(tmp_path / name), "youtube")
            seen.append(digests(tmp_path / name / "release" / "youtube"))
    assert all(other == seen[0] for other in seen)
    assert set(seen[0]) == FILES


def test_the_profile_says_how_large_a_shard_is(tmp_path: Path, make_rows, run_at, fill) -> None:
    few = make_rows("reddit/comments", 1_000)
    rows = pa.concat_tables([few] * 140).set_column(
        few.column_names.index("comment_id"),
        "comment_id",
        pa.array([f"{number:07d}" for number in range(140_000)]),
    )
    fill(tmp_path, "reddit/comments", rows, 2)
    run = run_at(tmp_path)
    release = run.profile.release.model_copy(update={"shard_mb": 0.01})
    profile = run.profile.model_copy(update={"release": release})
    layouts.write_parquet(replace(run, profile=profile), "reddit")
    shards = sorted((tmp_path / "release/reddit").glob("comments-*"))
    assert [pq.read_metadata(path).num_rows for path in shards] == [131_072, 140_000 - 131_072]
    assert [path.name for path in shards] == [
        f"comments-0000{number}-of-00002.parquet" for number in range(2)
    ]


def test_an_older_release_goes_whole(tmp_path: Path, make_rows, run_at, fill) -> None:
    fill(tmp_path, "youtube/videos", make_rows("youtube/videos", 5), 1)
    old = tmp_path / "release" / "youtube"
    old.mkdir(parents=True)
    (old / "SHA256SUMS").write_text("old")
    (old / "videos-00001-of-00002.parquet").write_text("old")
    layouts.write_parquet(
        run_at(tmp_path),
        "youtube",
        add_files=lambda fresh: (fresh / "extra.tar").write_bytes(b"x") and None,
    )
    assert {path.name for path in old.iterdir()} == {"extra.tar", *FILES}


def test_nothing_to_export(tmp_path: Path, run_at) -> None:
    with pytest.raises(FatalError, match="nothing to export") as caught:
        layouts.write_parquet(run_at(tmp_path), "youtube")
    assert caught.value.hint == "run `kb youtube filter` first"
    assert not (tmp_path / "release").exists()


def test_rows_come_sorted_out_of_all_files(tmp_path: Path, make_rows, fill) -> None:
    with pytest.raises(FatalError):
        check_rows(tmp_path, "youtube/videos")
    rows = make_rows("youtube/videos", 20)
    fill(tmp_path, "youtube/videos", rows, 3)
    check_rows(tmp_path, "youtube/videos")
    read = [row["video_id"] for row in sorted_rows(tmp_path, "youtube/videos", ["video_id"])]
    assert read == sorted(rows["video_id"].to_pylist())


@pytest.mark.parametrize("items", [[], ["é"], [1, {"a": None}]])
def test_a_json_list_appears_only_when_it_is_complete(tmp_path: Path, items: list[object]) -> None:
    path = tmp_path / "list.json"
    with json_list(path) as add:
        for item in items:
            add(item)
        assert not path.exists()
    assert json.loads(path.read_text(encoding="ascii")) == items
