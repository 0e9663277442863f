"""Released columns, values and samples are what the schemas declare."""

import json
from pathlib import Path

import pyarrow as pa
import pytest

from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused, rewritten, with_first
from tests.release.made import build


@pytest.mark.parametrize("column", ["title", "body", "author_hash", "source_url"])
def test_content_columns_of_reddit(tmp_path: Path, column: str) -> None:
    build(tmp_path, sources=("reddit",))
    shard = tmp_path / "release" / "reddit" / "posts-00000-of-00001.parquet"
    rewritten(shard, lambda rows: rows.append_column(column, pa.array(["x"] * rows.num_rows)))
    assert refused(tmp_path) == [
        f"content: reddit/posts-00000-of-00001.parquet: column {column} may not be released"
    ]


@pytest.mark.parametrize(
    "text", ["a title that somebody wrote", "https://i.redd.it/abc.png", "u/somebody"]
)
def test_content_hidden_in_a_released_column_of_reddit(tmp_path: Path, text: str) -> None:
    build(
        tmp_path, changed("reddit/comments", lambda row: row.update(score_source=text)), ("reddit",)
    )
    assert (
        "content: reddit/comments-00000-of-00001.parquet: column score_source contains text"
        " that is not an id"
    ) in refused(tmp_path)


def test_undescribed_column(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet",
        lambda rows: rows.append_column("mood", pa.array(["x"] * rows.num_rows)),
    )
    assert refused(tmp_path) == [
        (
            "undescribed: youtube/videos-00001-of-00002.parquet:"
            " column mood is not described in schemas/"
        )
    ]


def test_column_of_another_type_or_missing(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    rewritten(
        tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet",
        lambda rows: rows.drop_columns(["fps"]).set_column(
            rows.column_names.index("width"), "width", rows["width"].cast(pa.string())
        ),
    )
    lines = refused(tmp_path)
    where = "undescribed: youtube/videos-00000-of-00002.parquet"
    assert f"{where}: column width is string, not int64" in lines
    assert f"{where}: column fps is missing" in lines


def test_sample_in_json_with_content(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",))
    release(a_run(tmp_path))
    path = tmp_path / "release" / "reddit" / "posts.sample.json"
    rows = json.loads(path.read_text())
    for edit, line in (
        ({"title": "x"}, "content: {}: column title may not be released"),
        ({"mood": "x"}, "undescribed: {}: column mood is not described in schemas/"),
        (
            {"post_id": "somebody wrote this"},
            "content: {}: column post_id contains text that is not an id",
        ),
        ({"type": "poem"}, "content: {}: column type contains other values than "),
        ({"score": "many"}, "undescribed: {}: column score contains other values than int64"),
        ({"post_id": None}, "null: {}: column post_id has rows without a value"),
        (
            {"created_utc": "soon"},
            "undescribed: {}: column created_utc contains other values than ",
        ),
    ):
        path.write_text(json.dumps([rows[0] | edit, *rows[1:]]))
        wanted = line.format("reddit/posts.sample.json")
        assert any(said.startswith(wanted) for said in refused(tmp_path)), line
    path.write_text(json.dumps(rows))
    release(a_run(tmp_path))


def test_null_where_the_schema_knows_none(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    shard = tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet"
    rewritten(shard, lambda rows: with_first(rows, "fetched_at", None))
    (line,) = refused(tmp_path)
    assert line.startswith(
        "null: youtube/videos-00000-of-00002.parquet: column fetched_at has rows without a value"
    )


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [
        ("comments", "score_source", "Notch_1990"),
        ("posts", "type", "u_SomeAuthor"),
        ("posts", "post_id", "SomeAuthor"),
        ("comments", "parent_id", "u_author"),
        ("comments", "comment_id", "abc\nd"),
    ],
)
def test_a_name_where_reddit_has_words_and_ids(
    tmp_path: Path, table: str, column: str, text: str
) -> None:
    build(tmp_path, sources=("reddit",))
    where = f"reddit/{table}-00000-of-00001.parquet"
    rewritten(tmp_path / "release" / where, lambda rows: with_first(rows, column, text))
    (line,) = refused(tmp_path)
    assert line.startswith(f"content: {where}: column {column} contains ")
    assert text not in line


def test_damaged_shard_is_a_line_and_no_crash(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    shard = tmp_path / "release" / "youtube" / "videos-00000-of-00002.parquet"
    shard.write_bytes(shard.read_bytes()[:500])
    lines = refused(tmp_path)
    assert any(
        line.startswith("damaged: youtube/videos-00000-of-00002.parquet: can't be read")
        for line in lines
    )
