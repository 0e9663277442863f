"""Queries only read the views."""

from pathlib import Path

import pytest

from kb import query
from kb.core.errors import UsageError
from kb.query.statements import views_needed
from kb.store.tables.shard_writer import write_table
from tests.query.conftest import rows

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
    "UPDATE EXTENSIONS",
    "SELECT * FROM parquet_metadata('/etc/hosts')",
    "SELECT * FROM sniff_csv('/etc/passwd')",
    "FROM root",
]


@pytest.mark.parametrize("sql", ESCAPES)
def test_nothing_but_reading_the_tables(root: Path, tmp_path: Path, sql: str, make_rows) -> None:
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


@pytest.mark.parametrize(
    ("sql", "named"),
    [
        ("SELECT 1", 0),
        ("FROM clean.Pairs", 1),
        ('FROM "release" . "reddit_posts" SELECT count(*)', 1),
        ("WITH v AS (FROM youtube_videos) SELECT count(*) FROM v, clean . pairs", 3),
        ("FROM memory.main.youtube_videos SELECT count(*)", 2),
        ("PIVOT youtube_rejected ON stage USING count(*)", 1),
        ("DESCRIBE pairs", None),
        ("SHOW ALL TABLES", None),
        ("SELECT table_name FROM information_schema.tables ORDER BY ALL", None),
        ("SELECT view_name FROM duckdb_views() ORDER BY ALL", None),
    ],
)
def test_a_query_answers_the_same_with_the_views_that_it_needs(
    root: Path, sql: str, named: int | None
) -> None:
    """None: it asks which views there are, so it needs all of them."""
    views = query.find_views(root)
    needed = views_needed(sql, views)
    assert len(needed) == (len(views) if named is None else named)
    with query.connect(root, needed) as con:
        answer = query.select(con, sql, root=root, views=views).read_all().to_pylist()
    answered = [tuple(row.values()) for row in answer]
    assert sorted(answered, key=repr) == sorted(rows(root, sql), key=repr)
