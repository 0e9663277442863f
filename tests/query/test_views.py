"""kb query: its views, bare names, one clear line for mistakes, and nothing but reading."""

from __future__ import annotations

import threading
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb import query
from kb.artifacts import manifest
from kb.core.errors import DamagedData, FatalError, UsageError
from kb.query.limits import Limits, limited
from kb.store import tombstones
from kb.store.layout import Layout
from kb.store.shards import write_table


@pytest.fixture
def root(tmp_path: Path, make_rows) -> Path:  # type: ignore[no-untyped-def]
    root = tmp_path / "it's [a] *root*"
    write_table(
        root / "clean/youtube/videos/part-00000.parquet",
        make_rows("youtube/videos", 4),
        "youtube/videos",
    )
    write_table(
        root / "clean/youtube/videos/part-00001.parquet",
        make_rows("youtube/videos", 3),
        "youtube/videos",
    )
    write_table(
        root / "clean/youtube/rejected/part-00000.parquet",
        make_rows("shared/rejected", 2),
        "shared/rejected",
    )
    write_table(
        root / "release/youtube/videos-00000-of-00001.parquet",
        make_rows("youtube/videos", 5, released=True),
        "youtube/videos",
        released=True,
    )
    write_table(
        root / "release/reddit/posts-00000-of-00001.parquet",
        make_rows("reddit/posts", 6, released=True),
        "reddit/posts",
        released=True,
    )
    write_table(root / "pairs/part-00000.parquet", make_rows("pairs/pairs", 1), "pairs/pairs")
    tombstones.add(root, "youtube", [("gone", "named")])
    return root


def rows(root: Path, sql: str) -> list[tuple[object, ...]]:
    with query.connect(root) as con:
        return [tuple(row.values()) for row in query.select(con, sql).read_all().to_pylist()]


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
    ].endswith("+00")  # type: ignore[attr-defined]


def test_the_catalog(root: Path) -> None:
    listing = query.catalog(root)
    assert [row[:3] for row in listing] == [
        ("clean", "pairs", 1),
        ("clean", "youtube_rejected", 2),
        ("clean", "youtube_tombstones", 1),
        ("clean", "youtube_videos", 7),
        ("release", "reddit_posts", 6),
        ("release", "youtube_videos", 5),
    ]
    assert all(row[3] for row in listing)


@pytest.mark.parametrize(
    ("sql", "said", "hint"),
    [
        (
            "SELECT titel FROM youtube_videos",
            'Referenced column "titel" not found in FROM clause! Candidate bindings: "title"',
            "--tables",
        ),
        (
            "SELECT * FROM youtube_video",
            "Table with name youtube_video does not exist! Did you mean youtube_videos?",
            "--tables",
        ),
        (
            "SELECT * FROM wiki_pages",
            "Table with name wiki_pages does not exist!",
            "`kb wiki crawl`, then `kb wiki filter`",
        ),
        ("SELEC 1", 'syntax error at or near "SELEC"', "--tables"),
        ("", "is empty", ""),
        ("SELECT 1; SELECT 2", "2 statements", ""),
        ("SELECT 'x'::INT", "Could not convert string 'x' to INT32", ""),
    ],
)
def test_a_mistake_is_one_line_with_a_hint(root: Path, sql: str, said: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert hint in caught.value.hint


# What reaches for anything but the views; {tmp} is a folder that holds other.parquet.
ESCAPES = [
    "CREATE TABLE t AS SELECT 1",
    "ATTACH '{tmp}/x.db'",
    "COPY youtube_videos TO '{tmp}/x.csv'",
    "SET enable_external_access = true",
    "INSTALL httpfs",
    "SELECT * FROM read_csv('/etc/hosts')",
    "SELECT * FROM '{tmp}/other.parquet'",
    "DELETE FROM clean.youtube_videos",
    "SELECT * FROM read_text('/etc/hosts')",
    "EXPORT DATABASE '{tmp}/x'",
    "PRAGMA database_list",
    "SELECT * FROM glob('/etc/*')",
    (
        "COPY (PIVOT youtube_videos ON view_count USING count(*)) TO"
        " '{root}/clean/youtube/videos/x.parquet'"
    ),
    "CREATE TABLE t AS PIVOT youtube_videos ON view_count USING count(*)",
    "EXPLAIN ANALYZE COPY (SELECT 1) TO '{root}/clean/youtube/videos/x.parquet'",
    (
        "/* é */ EXPLAIN (ANALYZE, FORMAT JSON) COPY (SELECT 1) TO"
        " '{root}/clean/youtube/videos/x.parquet'"
    ),
    (
        "EXPLAIN ANALYZE COPY (PIVOT youtube_videos ON view_count"
        " USING count(*)) TO '{root}/clean/youtube/videos/x.parquet'"
    ),
    "SELECT * FROM read_blob('{root}/raw/youtube/tombstones.parquet')",
    "SELECT * FROM read_text('{root}/raw/youtube/note.txt')",
    "SELECT * FROM glob('{root}/raw/youtube/*')",
    "SELECT * FROM read_text('{root}/clean/youtube/videos/note.txt')",
    "FROM duckdb_settings()",
    'FROM "duckdb_settings" /* or */ ()',
    "FROM system.main.DuckDB_Settings ()",
    "SELECT current_setting('temp_directory')",
    "SELECT 'temp_directory'.current_setting()",
    "FROM pg_catalog.pg_settings",
    "SHOW memory_limit",
    "FROM (DESCRIBE temp_directory)",
    "SET VARIABLE x = 1",
    "SELECT getenv('HOME')",
    "FROM query('FROM duckdb_' || 'settings()')",
    "FROM json_execute_serialized_sql(json_serialize_sql('FROM duckdb_settings()'))",
    "FROM arrow_scan(1::POINTER, 2::POINTER, 3::POINTER)",
    "FROM duckdb_secrets()",
    "FROM duckdb_logs",
    "FROM enable_profiling()",
    "SELECT * FROM 'https://example.com/x.parquet'",
    "SELECT * FROM read_parquet('s3://bucket/x.parquet')",
    "LOAD httpfs",
    "CALL enable_logging()",
    "EXPORT DATABASE '{tmp}/x' (FORMAT parquet)",
    "IMPORT DATABASE '{tmp}'",
    "CREATE MACRO f() AS 1",
    "PREPARE p AS SELECT 1",
    "VACUUM",
    "SELECT * FROM parquet_metadata('/etc/hosts')",
    "SELECT * FROM sniff_csv('/etc/passwd')",
    "FROM root",
]


@pytest.mark.parametrize("sql", ESCAPES)
def test_nothing_but_reading_the_tables(root: Path, tmp_path: Path, sql: str, make_rows) -> None:  # type: ignore[no-untyped-def]
    write_table(tmp_path / "other.parquet", make_rows("shared/failed", 1), "shared/failed")
    for folder in ("raw/youtube", "clean/youtube/videos"):
        (root / folder / "note.txt").write_text("a secret")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(UsageError):
        rows(root, sql.format(tmp=tmp_path, root=str(root).replace("'", "''")))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "sql",
    [
        "PIVOT youtube_rejected ON stage USING count(*)",
        "-- how many\nWITH p AS (PIVOT youtube_rejected ON stage USING count(*)) FROM p",
        "(FROM (PIVOT youtube_rejected ON stage USING count(*)))",
        "EXPLAIN SELECT 1",
        "EXPLAIN (ANALYZE, FORMAT JSON) PIVOT youtube_rejected ON stage USING count(*)",
        "SUMMARIZE youtube_rejected",
        "DESCRIBE PIVOT youtube_rejected ON stage USING count(*)",
        "PIVOT (SELECT stage, INTERVAL 1 DAY AS i FROM youtube_rejected) ON stage USING max(i)",
        "VALUES (1)",
    ],
)
def test_whatever_only_reads(root: Path, sql: str) -> None:
    assert rows(root, sql)


def test_pages_that_are_broken_name_their_file_also_while_rows_stream(root: Path) -> None:
    file = root / "clean/youtube/videos/part-00001.parquet"
    data = bytearray(file.read_bytes())
    data[4:200] = b"\xff" * 196
    file.write_bytes(data)
    with (
        query.connect(root) as con,
        pytest.raises(DamagedData, match=r"part-00001\.parquet can't be read"),
    ):
        query.select(con, "FROM clean.youtube_videos", root=root).read_all()


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT count(*) FROM clean.youtube_videos",
        "SELECT max(title) FROM Youtube_Videos",
        "SUMMARIZE youtube_videos",
    ],
)
def test_a_changed_bit_never_changes_an_answer(root: Path, sql: str) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    manifest.record(root / "clean/youtube", "clean/youtube")
    with query.connect(root) as con:
        query.select(con, sql, root=root).read_all()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    with query.connect(root) as con:
        query.select(con, "FROM release.youtube_videos", root=root).read_all()  # another's files
        with pytest.raises(DamagedData, match=f"{path.name} can't be read: checksum mismatch"):
            query.select(con, sql, root=root).read_all()


def test_an_empty_root_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "data" / "state").mkdir(parents=True)
    with pytest.raises(FatalError, match="no tables in ") as caught:
        rows(tmp_path / "data", "FROM youtube_videos")
    assert "kb demo" in caught.value.hint
    assert query.catalog(tmp_path) == []


def test_a_damaged_file_is_named(root: Path) -> None:
    (root / "clean/youtube/rejected/part-00000.parquet").write_bytes(b"no parquet")
    with pytest.raises(DamagedData, match="rejected"):
        query.connect(root)
    with pytest.raises(DamagedData, match="rejected"):
        query.catalog(root)


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


def test_what_was_reconstructed(tmp_path: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
    out = Layout(tmp_path).reconstructed
    for name in ("posts", "comments"):
        made = make_rows(f"reddit/{name}", 2)
        write_table(out / name / "part-00000.parquet", made, f"reddit/{name}")
    write_table(out / "missing.parquet", make_rows("reddit/missing", 1), "reddit/missing")
    for place in (tmp_path, out):  # the data root, and the folder of --out itself
        assert rows(place, "SELECT count(*) FROM restored.reddit_comments") == [(2,)]
        assert rows(place, "SELECT count(*) FROM reddit_posts") == [(2,)]
        assert [(view.schema, view.view, view.rows) for view in query.catalog(place)] == [
            ("restored", "reddit_comments", 2),
            ("restored", "reddit_missing", 1),
            ("restored", "reddit_posts", 2),
        ]


def test_clean_and_released_rows_go_first(root: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
    out = Layout(root).reconstructed
    posts = make_rows("reddit/posts", 2)
    write_table(out / "posts/part-00000.parquet", posts, "reddit/posts")
    write_table(out / "missing.parquet", make_rows("reddit/missing", 1), "reddit/missing")
    assert rows(root, "SELECT count(*) FROM reddit_posts") == [(6,)]
    assert rows(root, "SELECT count(*) FROM restored.reddit_posts") == [(2,)]


def test_links(root: Path) -> None:
    (root / "links").mkdir()
    one = pa.table({"entity": ["Creeper"]})
    pq.write_table(one, root / "links" / "entities.parquet")
    for number in range(2):
        pq.write_table(one, root / "links" / f"links-{number:05d}-of-00002.parquet")
    assert rows(root, "FROM links.entities") == [("Creeper",)]
    assert rows(root, "SELECT count(*) FROM links.links") == [(2,)]
    assert rows(root, "SELECT count(*) FROM links") == [(2,)]


@pytest.mark.parametrize(
    ("sql", "guess", "never"),
    [
        ("FROM youtube_vidoes", "Did you mean youtube_videos", "pairs"),
        ("FROM relase.youtube_videos", "release.youtube_videos", "rejected"),
        ("FROM release.youtube_vidoes", "Did you mean release.youtube_videos", "reddit"),
        ("SELECT v.titel FROM youtube_videos v", "Did you mean title", "width"),
        ("SELECT titel FROM youtube_videos", 'Candidate bindings: "title"', "width"),
    ],
)
def test_an_unknown_name_is_told_with_the_nearest_alone(
    root: Path, sql: str, guess: str, never: str
) -> None:
    with pytest.raises(UsageError) as caught:
        rows(root, sql)
    said = f"{caught.value}; {caught.value.hint}"
    assert guess in said
    assert never not in said
    assert len(said) < 250


def test_many_shards_open_without_being_read(root: Path) -> None:
    """A view costs its first file's footer; the others are read when they are asked for."""
    folder = root / "clean/youtube/videos"
    for number in range(2, 300):
        (folder / f"part-{number:05d}.parquet").symlink_to(root / "nowhere")
    with query.connect(root) as con:
        assert query.select(con, "SELECT 1").read_all().num_rows == 1


def test_nothing_of_a_query_runs_on_when_it_has_answered() -> None:
    """A thread with the connection in its hands at the end of Python is told as leaked memory."""
    before = set(threading.enumerate())
    con = duckdb.connect()
    with limited(con, Limits(seconds=60, memory=1 << 30)):
        con.execute("SELECT 1").fetchall()
    assert set(threading.enumerate()) == before
