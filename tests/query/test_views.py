"""Views of clean, released and restored tables, and their bare names."""

from pathlib import Path

import duckdb
import pyarrow.parquet as pq
import pytest

from kb import query
from kb.core.errors import DamagedData, FatalError
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table
from tests.query.conftest import rows


def test_clean_and_release_and_bare_names(root: Path) -> None:
    assert rows(root, "SELECT count(*) FROM clean.youtube_videos") == [(7,)]
    assert rows(root, "SELECT count(*) FROM release.youtube_videos") == [(5,)]
    assert rows(root, "SELECT count(*) FROM youtube_videos") == [(7,)]
    assert rows(root, "SELECT count(*) FROM reddit_posts") == [(6,)]
    assert rows(root, "SELECT count(*) FROM pairs") == [(1,)]
    assert rows(root, "FROM youtube_tombstones SELECT key, reason") == [("gone", "named")]
    assert rows(root, "SELECT stage, count(*) FROM youtube_rejected GROUP BY ALL ORDER BY ALL") == [
        ("stage 00000", 1),
        ("stage 00001", 1),
    ]
    assert "description" in {row[0] for row in rows(root, "DESCRIBE clean.youtube_videos")}
    assert "description" not in {row[0] for row in rows(root, "DESCRIBE release.youtube_videos")}


def test_times_are_utc(root: Path) -> None:
    assert rows(root, "SELECT fetched_at::VARCHAR FROM release.youtube_videos LIMIT 1")[0][
        0
    ].endswith("+00")


def test_the_catalog(root: Path) -> None:
    listing = query.catalog(query.find_views(root))
    assert [row[:3] for row in listing] == [
        ("clean", "pairs", 1),
        ("clean", "youtube_rejected", 2),
        ("clean", "youtube_tombstones", 1),
        ("clean", "youtube_videos", 7),
        ("release", "reddit_posts", 6),
        ("release", "youtube_videos", 5),
    ]
    assert all(row[3] for row in listing)


def test_an_empty_root_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "data" / "state").mkdir(parents=True)
    with pytest.raises(FatalError, match="no tables in ") as caught:
        rows(tmp_path / "data", "FROM youtube_videos")
    assert "kb demo" in caught.value.hint
    assert query.catalog(query.find_views(tmp_path)) == []


def test_a_damaged_file_is_named(root: Path) -> None:
    (root / "clean/youtube/rejected/part-00000.parquet").write_bytes(b"no parquet")
    with pytest.raises(DamagedData, match="rejected"):
        query.connect(root)
    with pytest.raises(DamagedData, match="rejected"):
        query.catalog(query.find_views(root))


def test_plain_duckdb_reads_the_same(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root / "release" / "youtube")
    assert duckdb.connect().sql(
        "SELECT count(*) FROM read_parquet('videos-*.parquet')"
    ).fetchall() == [(5,)]


def test_show_tables_has_each_name_once(root: Path) -> None:
    names = [name for (name,) in rows(root, "SHOW TABLES")]
    assert names == sorted(set(names))
    assert {"youtube_videos", "reddit_posts", "pairs"} <= set(names)
    everywhere = rows(root, "SELECT table_schema, table_name FROM information_schema.tables")
    assert len(everywhere) == len(set(everywhere))
    assert {("clean", "youtube_videos"), ("release", "youtube_videos")} <= set(everywhere)
    assert rows(root, "SELECT column_name FROM (SUMMARIZE youtube_rejected)")


def test_what_was_reconstructed(tmp_path: Path, make_rows) -> None:
    out = Layout(tmp_path).reconstructed
    for name in ("posts", "comments"):
        made = make_rows(f"reddit/{name}", 2)
        write_table(out / name / "part-00000.parquet", made, f"reddit/{name}")
    write_table(out / "missing.parquet", make_rows("reddit/missing", 1), "reddit/missing")
    for place in (tmp_path, out):  # the data root, and the folder of --out itself
        assert rows(place, "SELECT count(*) FROM restored.reddit_comments") == [(2,)]
        assert rows(place, "SELECT count(*) FROM reddit_posts") == [(2,)]
        assert [
            (view.schema, view.view, view.rows) for view in query.catalog(query.find_views(place))
        ] == [
            ("restored", "reddit_comments", 2),
            ("restored", "reddit_missing", 1),
            ("restored", "reddit_posts", 2),
        ]


def test_clean_and_released_rows_go_first(root: Path, make_rows) -> None:
    out = Layout(root).reconstructed
    posts = make_rows("reddit/posts", 2)
    write_table(out / "posts/part-00000.parquet", posts, "reddit/posts")
    write_table(out / "missing.parquet", make_rows("reddit/missing", 1), "reddit/missing")
    assert rows(root, "SELECT count(*) FROM reddit_posts") == [(6,)]
    assert rows(root, "SELECT count(*) FROM restored.reddit_posts") == [(2,)]


def test_links(root: Path, make_rows) -> None:
    (root / "links").mkdir()
    entities = make_rows("links/entities", 1, entity=["Creeper"])
    pq.write_table(entities, root / "links" / "entities.parquet")
    for number in range(2):
        links = make_rows("links/links", 1)
        pq.write_table(links, root / "links" / f"links-{number:05d}-of-00002.parquet")
    assert rows(root, "SELECT entity FROM links.entities") == [("Creeper",)]
    assert rows(root, "SELECT count(*) FROM links.links") == [(2,)]
    assert rows(root, "SELECT count(*) FROM links") == [(2,)]


def test_many_shards_open_without_being_read(root: Path) -> None:
    """A view costs its first file's footer; the others are read when they are asked for."""
    folder = root / "clean/youtube/videos"
    for number in range(2, 300):
        (folder / f"part-{number:05d}.parquet").symlink_to(root / "nowhere")
    with query.connect(root) as con:
        assert query.select(con, "SELECT 1").read_all().num_rows == 1
