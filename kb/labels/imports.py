"""Label Studio's exports → labels/, and what they say of all items in pairs/measures.json.

Of several judgements of a person about an item the newest counts, so that importing a file again,
or files in another order, gives the same bytes.
"""

from __future__ import annotations

import codecs
import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import msgspec
import pyarrow as pa
from duckdb import DuckDBPyConnection

from kb.artifacts import domain_binding, manifest
from kb.artifacts.measures import write_measure
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import FatalError, UsageError
from kb.core.regular_file import read_regular
from kb.core.summary import Summary
from kb.labels.agreement import figures
from kb.labels.questions import KINDS, LabelQuestion
from kb.pairs.transcripts import VIDEOS
from kb.schema.tables import conform, table
from kb.store.layout import Layout
from kb.store.state import tombstones
from kb.store.tables import database, parquet
from kb.store.tables.reading import scan
from kb.store.tables.shard_writer import write_table

SECTION = "labels"  # of pairs/measures.json
_FILE = "labels-00000-of-00001.parquet"

LABELS = "labels/labels"


def import_exports(run: Run, paths: Sequence[Path]) -> Summary:
    """Read every file, then write. Answers about items that were purged or that no table has are
    refused and counted.

    Raises UsageError for a file that is no export, FatalError without pairs and tasks,
    WriterLocked, DamagedData, DiskFull.
    """
    left: Counter[str] = Counter()
    answers = [row for path in paths for task in _tasks(path) for row in _rows(task, left)]
    given = pa.Table.from_pylist(answers, table(LABELS).arrow())
    if not any(manifest.rows(run.root, one.table) for one in KINDS.values()):
        raise FatalError(
            "there are no pairs and no tasks", hint="run `kb pairs` or `kb tasks` first"
        )
    with domain_binding.writing(run, "labels", "pairs"), database.connect(run.root) as con:
        old = stored(run.root)
        con.register("given", given)
        con.register("old", old)
        counts = _judge(con, run.root)
        rows = conform(LABELS, con.sql(_NEWEST).to_arrow_table())
        if not rows.equals(old):
            _write(run.root, rows)
        section = _measured(con, run.root, rows)
    return Summary(
        command="label import",
        answers=len(answers),
        added=rows.num_rows - old.num_rows,
        labels=rows.num_rows,
        skipped=left["skipped"],
        no_result=left["no_result"],
        no_annotations=left["no_annotations"],
        undefined=left["undefined"],
        **counts,
        figures=section,
        path=str(Layout(run.root).labels),
    )


def unite(run: Run, others: Sequence[Path]) -> int:
    """Add the answers of other data roots, of which the newest of a person about an item count; how
    many rows are new. Those about purged videos stay away.

    Raises WriterLocked, DamagedData, DiskFull.
    """
    none = table(LABELS).arrow().empty_table()
    theirs = pa.concat_tables([none, *map(stored, others)])
    if not theirs.num_rows:
        return 0
    with domain_binding.writing(run, "labels", "pairs"), database.connect(run.root) as con:
        old = stored(run.root)
        con.register("given", theirs)
        con.register("old", old)
        _register_purged(con, run.root)
        con.execute(
            "CREATE TEMP TABLE merged AS SELECT * FROM"
            " (FROM old UNION ALL BY NAME FROM given) ANTI JOIN purged USING (video_id)"
        )
        rows = conform(LABELS, con.sql(_NEWEST).to_arrow_table())
        if not rows.equals(old):
            _write(run.root, rows)
    measure_labels(run)
    return max(0, rows.num_rows - old.num_rows)


def measure_labels(run: Run) -> None:
    """Write the figures of the answers that are there beside the pairs, where there are some.

    Raises WriterLocked, DamagedData, DiskFull.
    """
    if manifest.read_manifest(run.root, "pairs") is None:
        return
    rows = stored(run.root)
    if not rows.num_rows:
        write_measure(run.root, SECTION, {})
        return
    with domain_binding.writing(run, "labels", "pairs"), database.connect(run.root) as con:
        con.register("given", rows.slice(0, 0))
        con.register("old", rows)
        _judge(con, run.root)
        _measured(con, run.root, rows)


def stored(root: Path) -> pa.Table:
    """All answers that are there."""
    none = table(LABELS).arrow().empty_table()
    tables = [parquet.read_table(path) for path in manifest.rows(root, LABELS)]
    return pa.concat_tables([none, *tables]).combine_chunks()


def replace_answers(
    root: Path, kind: str, item_id: str, annotator: int, answers: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Write a person's answers to an item in place of those that they gave before, which are
    returned. Call it under the lock of labels.
    """
    key, ours = ("kind", "item_id", "annotator"), (kind, item_id, annotator)
    every = stored(root).to_pylist()
    before = [row for row in every if tuple(row[name] for name in key) == ours]
    kept = [row for row in every if tuple(row[name] for name in key) != ours]
    rows = sorted([*kept, *answers], key=lambda row: [row[name] for name in (*key, "question")])
    _write(root, pa.Table.from_pylist(rows, table(LABELS).arrow()))
    return before


def _write(root: Path, rows: pa.Table) -> None:
    with manifest.replacing(root, "labels", inputs={}) as fresh:
        write_table(fresh.folder / _FILE, rows, LABELS)


def _judge(con: DuckDBPyConnection, root: Path) -> dict[str, int]:
    """Make items, sizes and merged of `given` and `old`; what was refused, and what differs."""
    selects = []
    for kind, one in KINDS.items():
        # Figures are of all items as they were found, so judgements that took some out change none.
        begin, end = one.found or (one.start, one.end)
        for name, where in ((one.table, "true"), *one.rejected):
            if files := manifest.rows(root, name):
                parquet.verify_files(*files)
                selects.append(
                    f"SELECT '{kind}' AS kind, {one.key} AS item_id, video_id,"
                    f" {one.stratum} AS stratum, {begin} AS start_s, {end} AS end_s"
                    f" FROM {scan(files)} WHERE {where}"
                )
    _register_purged(con, root)
    con.execute(f"CREATE VIEW every AS {' UNION ALL '.join(selects)}")
    con.execute(_TABLES)
    return {name: int(con.execute(sql).fetchall()[0][0]) for name, sql in _COUNTED.items()}


def _register_purged(con: DuckDBPyConnection, root: Path) -> None:
    purged = pa.array(sorted(tombstones.keys(root, VIDEOS)), pa.string())
    con.register("purged", pa.table({"video_id": purged}))


def _measured(con: DuckDBPyConnection, root: Path, rows: pa.Table) -> dict[str, Any]:
    """The figures of all labels by kind, written beside the pairs where there are some; after
    `_judge`.
    """
    con.register("labels", rows)
    judged = set(rows["kind"].to_pylist())
    section = {kind: figures(con, one) for kind, one in KINDS.items() if kind in judged}
    if manifest.read_manifest(root, "pairs") is not None:
        write_measure(root, SECTION, section)
    return section


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
                = max(labelled_at) OVER (
                    PARTITION BY kind, item_id, annotator, ends_with(question, '_aligned')))
        ORDER BY kind, item_id, annotator, question, answer)
    ORDER BY kind::VARCHAR, item_id, annotator, question::VARCHAR"""


_EXPORT = "export the project from Label Studio as JSON (not JSON-MIN)"


class LabeledItem(msgspec.Struct):
    """`data` of a task: what `kb label export` wrote of the item."""

    item_id: str
    kind: Literal["pair", "task"]
    video_id: str


class _Annotation(msgspec.Struct):
    """A judgement. What else than usual stands in its fields costs that field or this judgement."""

    result: list[Any]
    completed_by: Any = None
    was_cancelled: Any = None
    created_at: Any = None
    updated_at: Any = None


class _Task(msgspec.Struct):
    """An item with its judgements, a list where there are any."""

    data: LabeledItem
    annotations: Any = None


def _tasks(path: Path) -> list[_Task]:
    try:
        tasks = msgspec.json.decode(
            read_regular(path).removeprefix(codecs.BOM_UTF8), type=list[_Task]
        )
    except OSError as error:
        raise UsageError(f"{path} can't be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(
            f"{path} is not an export of a labelling project: {error}",
            hint=_EXPORT,
        ) from None
    if tasks and not any(isinstance(task.annotations, list) for task in tasks):
        raise UsageError(
            f"{path} is not an export of a labelling project: no task in it has annotations",
            hint=_EXPORT,
        )
    return tasks


def _rows(task: _Task, counts: Counter[str]) -> Iterator[dict[str, Any]]:
    """The answers of a task. Counts what is not taken: `no_annotations`, tasks without a list of
    judgements; `no_result`, judgements that are null or have no list of answers; `skipped`,
    judgements that were skipped or have no answer; `undefined`, answers to other questions, with
    other options, or whose end is before their beginning.
    """
    asked = {one.name: one for one in KINDS[task.data.kind].questions}
    if not isinstance(task.annotations, list):
        counts["no_annotations"] += 1
        return
    for judgement in task.annotations:
        if not isinstance(judgement, dict) or not isinstance(judgement.get("result"), list):
            counts["no_result"] += 1
            continue
        annotation = msgspec.convert(judgement, _Annotation)
        result = annotation.result
        # Relations between regions have no name.
        named = [
            (asked.get(str(one.get("from_name"))), one.get("value"))
            for one in result
            if isinstance(one, dict)
        ]
        answers = {
            one.name: answer(one, value)
            for one, value in named
            if one is not None and isinstance(value, dict)
        }
        if annotation.was_cancelled or not named:
            counts["skipped"] += 1
            continue
        begins, ends = (answers.get(name) for name in ("begins_s", "ends_s"))
        if begins and ends and float(begins) > float(ends):
            answers["begins_s"] = answers["ends_s"] = None
        given = {name: text for name, text in answers.items() if text is not None}
        counts["undefined"] += len(named) - len(given)
        at = _moment(annotation.updated_at) or _moment(annotation.created_at)
        common = {
            **msgspec.structs.asdict(task.data),
            "annotator": _number_of(annotation.completed_by),
            "labelled_at": at or datetime.fromtimestamp(0, UTC),
        }
        for name, text in given.items():
            yield {**common, "question": name, "answer": text}


def _number_of(person: Any) -> int:
    """Who judged, as a number; 0 for nobody. Of an address that stands in its place, a number by
    which nobody is found.
    """
    if isinstance(person, dict):
        person = person.get("id", person.get("email"))
    if isinstance(person, str) and person.strip():
        if person.strip().isdecimal() and len(person) < 10:
            return int(person)
        digest = hashlib.blake2b(person.strip().lower().encode("utf-8", "replace"), digest_size=4)
        return int.from_bytes(digest.digest(), "big") >> 1
    return person if isinstance(person, int) and 0 <= person < 1 << 62 else 0


def _moment(value: Any) -> datetime | None:
    """A time as ISO 8601 or in seconds or milliseconds since 1970; None for anything else."""
    try:
        if isinstance(value, str):
            at = clock.parse(value)
            return at if clock.FIRST <= at <= clock.LAST else None
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return clock.since_1970(value / 1000 if value > 1e11 else value)
    except (ValueError, OverflowError):
        pass
    return None


def answer(question: LabelQuestion, value: dict[str, Any]) -> str | None:
    """An answer as labels have it; None for one that the question does not have."""
    if question.options:
        names = {one: name for name, shown in question.options for one in (name, shown)}
        match value.get("choices"):
            case [str(chosen)]:
                return names.get(chosen)
        return None
    if question.is_number:
        number = value.get("number")
        return f"{number:.10g}" if isinstance(number, (int, float)) and number >= 0 else None
    text = value.get("text")
    joined = "\n".join(map(str, text)) if isinstance(text, list) else str(text or "")
    return " ".join(joined.split()) or None
