"""Answers of exports into labels/, and their figures into pairs/measures.json.

Of several judgements of a person about an item the newest counts, so that importing a file again,
or files in another order, gives the same bytes.
"""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from duckdb import DuckDBPyConnection

from kb.artifacts import domain_binding, manifest
from kb.artifacts.measures import write_measure
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.installation import require
from kb.core.summary import Summary
from kb.labels.exports import LABELS, read_exports
from kb.labels.figures import figures
from kb.labels.questions import KINDS
from kb.pairs.transcripts import VIDEOS
from kb.schema.table_check import conform
from kb.schema.tables import table
from kb.store.layout import Layout
from kb.store.state import tombstones
from kb.store.tables import database, parquet
from kb.store.tables.reading import scan
from kb.store.tables.shard_writer import write_table

SECTION = "labels"  # of pairs/measures.json
_FILE = "labels-00000-of-00001.parquet"


def import_exports(run: Run, paths: Sequence[Path]) -> Summary:
    """Read every file, then write. Answers about items that were purged or that no table has are
    refused and counted.

    Raises UsageError for a file that is no export, MissingExtra, before anything is written;
    FatalError without pairs and tasks, WriterLocked, DamagedData, DiskFull.
    """
    require("pairs", "numpy")  # before anything is written
    given = read_exports(paths)
    if not any(manifest.rows(run.root, one.table) for one in KINDS.values()):
        raise FatalError(
            "there are no pairs and no tasks", hint="run `kb pairs` or `kb tasks` first"
        )
    with domain_binding.writing(run, "labels", "pairs"), database.connect(run.root) as con:
        old = _stored(run.root)
        con.register("given", given.rows)
        con.register("old", old)
        counts = _judge(con, run.root)
        rows = conform(LABELS, con.sql(_NEWEST).to_arrow_table())
        if not rows.equals(old):
            with manifest.replacing(run.root, "labels", inputs={}) as fresh:
                write_table(fresh.folder / _FILE, rows, LABELS)
        con.register("labels", rows)
        judged = set(rows["kind"].to_pylist())
        section = {kind: figures(con, one) for kind, one in KINDS.items() if kind in judged}
        if manifest.read(run.root, "pairs") is not None:
            write_measure(run.root, SECTION, section)
    return Summary(
        command="label import",
        answers=given.rows.num_rows,
        added=rows.num_rows - old.num_rows,
        labels=rows.num_rows,
        skipped=given.skipped,
        undefined=given.undefined,
        **counts,
        figures=section,
        path=str(Layout(run.root).labels),
    )


def _stored(root: Path) -> pa.Table:
    files = manifest.rows(root, LABELS)
    rows = [parquet.read_table(path) for path in files]
    return pa.concat_tables([table(LABELS).arrow().empty_table(), *rows]).combine_chunks()


def _judge(con: DuckDBPyConnection, root: Path) -> dict[str, int]:
    """Make items, sizes and merged of `given` and `old`; what was refused, and what differs."""
    selects = []
    for kind, one in KINDS.items():
        if files := manifest.rows(root, one.table):
            parquet.check(*files)
            selects.append(
                f"SELECT '{kind}' AS kind, {one.key} AS item_id, video_id,"
                f" {one.stratum} AS stratum, {one.start} AS start_s, {one.end} AS end_s"
                f" FROM {scan(files)}"
            )
    purged = pa.array(sorted(tombstones.keys(root, VIDEOS)), pa.string())
    con.register("purged", pa.table({"video_id": purged}))
    con.execute(f"CREATE VIEW every AS {' UNION ALL '.join(selects)}")
    con.execute(_TABLES)
    return {name: _one(con, sql) for name, sql in _COUNTED.items()}


def _one(con: DuckDBPyConnection, sql: str) -> int:
    ((number,),) = con.execute(sql).fetchall()
    return int(number)


_TABLES = """
CREATE TEMP TABLE sizes AS SELECT kind, stratum, count(*) AS size FROM every GROUP BY ALL;
CREATE TEMP TABLE items AS FROM every
    WHERE item_id IN (SELECT item_id FROM given UNION ALL SELECT item_id FROM old);
CREATE TEMP TABLE merged AS
    SELECT * FROM old ANTI JOIN purged USING (video_id)
    UNION ALL BY NAME
    SELECT * FROM given
        SEMI JOIN items USING (kind, item_id, video_id) ANTI JOIN purged USING (video_id);
"""
_COUNTED = {
    "contradictory": """
        SELECT count(*) FROM (
            SELECT kind, item_id, annotator, question FROM merged
            GROUP BY ALL HAVING count(DISTINCT answer) > 1)""",
    "purged_items": """
        SELECT count(DISTINCT item_id) FROM given SEMI JOIN purged USING (video_id)""",
    "unknown_items": """
        SELECT count(DISTINCT item_id) FROM given
        ANTI JOIN purged USING (video_id) ANTI JOIN items USING (kind, item_id, video_id)""",
}
_NEWEST = """
    SELECT * FROM (
        SELECT DISTINCT ON (kind, item_id, annotator, question) * FROM (
            FROM merged QUALIFY labelled_at
                = max(labelled_at) OVER (PARTITION BY kind, item_id, annotator))
        ORDER BY kind, item_id, annotator, question, answer)
    ORDER BY kind::VARCHAR, item_id, annotator, question::VARCHAR"""
