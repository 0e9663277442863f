"""`kb diff`: which rows came, went and changed between two roots or releases, table by table.

Rows are the same where their declared keys are; they have changed where another column of both
sides differs, but for the time when it was read and hashes with another key. Why a row went is said
where the newer side knows it: a removal, the stage that rejects it now, what failed, waits or could
not be restored; of a row of a video, page or thread that went, why that did.

A source is compared in the fullest form that both sides have (clean, then released, restored), else
by the tables and columns that both have. DuckDB joins keys and digests of rows, and spills what its
memory does not hold.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple, Self

import pyarrow as pa

from kb.artifacts.release_folder import read_tombstones
from kb.artifacts.table_catalog import View, tombstones_view, view_name
from kb.core.errors import UsageError
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.suggestions import similar
from kb.query.remote_duckdb import RemoteFiles
from kb.query.remote_reading import reading_views
from kb.schema.tables import KEYED_HASHES, WHEN_READ, Table, table, tables, tables_of
from kb.store.layout import VERDICTS
from kb.store.tables import database
from kb.store.tables.reading import reading, scan

FORMS = ("clean", "links", "release", "restored")  # that are compared, the fullest first
_MEMORY = "2GB"
_BATCH = 10_000  # rows
_SHOWN = 4  # columns that were not compared
_WHY = "STRUCT(stage VARCHAR, reason VARCHAR, value VARCHAR, threshold VARCHAR)"


class ComparedTable(NamedTuple):
    """A declared table and its rows on both sides; None where a side has none of it."""

    declared: Table
    old: View | None
    new: View | None


class Owner(NamedTuple):
    """What a row may have gone with: `key` is SQL for its name in the verdicts of a source."""

    source: str
    key: str


class Comparison:
    """Two sides, open; use it as a context."""

    def __init__(self, old: Sequence[View], new: Sequence[View]) -> None:
        self.old = {view.full: view for view in old}
        self.new = {view.full: view for view in new}
        self.left_out: dict[str, list[str]] = {}  # by why, columns that were not compared
        self.con = database.connect(memory=_MEMORY)
        self._files = RemoteFiles()
        if any(view.remote for view in (*old, *new)):
            self.con.register_filesystem(self._files)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.con.close()

    def tables(self) -> dict[str, ComparedTable]:
        """What is compared, by the bare names of views, in the order of what is published."""
        compared = {}
        for source in PUBLISHED:
            old, new = (_form_of(source, side, other) for side, other in self._sides())
            for declared in tables().values():
                if declared.source != source:
                    continue
                name = view_name(declared)
                pair = self.old.get(f"{old}.{name}"), self.new.get(f"{new}.{name}")
                # In two forms a table that only one has is no difference of the rows.
                if all(pair) or (any(pair) and (old == new or not (old and new))):
                    compared[name] = ComparedTable(declared, *pair)
        return compared

    def _sides(self) -> list[tuple[Mapping[str, View], Mapping[str, View]]]:
        return [(self.old, self.new), (self.new, self.old)]

    def counts(self) -> pa.Table:
        """A row a table: table, came, went, changed. Raises DamagedData."""
        rows = []
        for name, compared in self.tables().items():
            with self._reading(compared):
                (counted,) = self.con.execute(
                    f"SELECT count(*) FILTER (change = 'came'), count(*) FILTER (change = 'went'),"
                    f" count(*) FILTER (change = 'changed') FROM ({self._changes(compared)})"
                ).fetchall()
            rows.append((name, *counted))
        names = ("table", "came", "went", "changed")
        kinds = [pa.string(), *[pa.int64()] * 3]
        columns = zip(*rows, strict=True) if rows else ([],) * len(names)
        return pa.table({n: pa.array(c, k) for n, c, k in zip(names, columns, kinds, strict=True)})

    @contextlib.contextmanager
    def rows(self, name: str) -> Iterator[pa.RecordBatchReader]:
        """The rows of a table that differ, by key: key, change (came, went or changed), and of
        those that went stage, reason, value and threshold. Raises UsageError, DamagedData.
        """
        known = self.tables()
        if name not in known:
            near = similar(name, known)
            hint = f"did you mean {' or '.join(near)}?" if near else f"compared: {', '.join(known)}"
            raise UsageError(f"no table {name!r} to compare", hint=hint)
        compared = known[name]
        with self._reading(compared):
            owners = _owners(compared.declared)
            self._note_reasons({owner.source for owner in owners})
            joins = "".join(
                f" LEFT JOIN reasons r{n} ON r{n}.source = '{owner.source}' AND r{n}.name = o{n}"
                for n, owner in enumerate(owners)
            )
            whys = "".join(f"r{n}.why, " for n in range(len(owners)))
            yield self.con.sql(
                "SELECT key, change, why.stage, why.reason, why.value, why.threshold FROM"
                f" (SELECT c.key, change, coalesce({whys}NULL::{_WHY}) AS why"
                f" FROM ({self._changes(compared, owners)}) c{joins}) ORDER BY key"
            ).to_arrow_reader(_BATCH)

    def _reading(self, compared: ComparedTable) -> contextlib.ExitStack:
        views = [view for view in (compared.old, compared.new) if view is not None]
        stack = contextlib.ExitStack()
        stack.enter_context(reading([path for view in views for path in view.files]))
        stack.enter_context(reading_views(views))
        return stack

    def _changes(self, compared: ComparedTable, owners: Sequence[Owner] = ()) -> str:
        """SQL of the rows that differ: key, change, and o0, o1 … of those that went."""
        declared, old, new = compared
        key = " || '/' || ".join(f"coalesce({_quoted(n)}::VARCHAR, '')" for n in declared.key)
        scans = [self._scan(view) if view else "" for view in (old, new)]
        kinds = [self._kinds(rows) if rows else {} for rows in scans]
        skipped = {*declared.key} | WHEN_READ
        if old and new and old.schema != new.schema:  # paths begin elsewhere, scores are not there
            skipped |= {column for _, column in PUBLISHED[declared.source].paths}
            old_empty, new_empty = map(self._without_values, scans, kinds)
            skipped |= self._leave_out("one side has no values", old_empty ^ new_empty, *kinds)
        if old and new:
            foreign = {name for name in KEYED_HASHES if self._no_common_value(name, scans, kinds)}
            skipped |= self._leave_out("hashed with another key", foreign)
        both = [name for name in kinds[1] if name in kinds[0] and name not in skipped]
        casts = [f"CAST({_quoted(name)} AS {kinds[1][name]})" for name in both]
        digest = f"hash({', '.join(casts)})" if casts else "0::UBIGINT"
        names = [f"{owner.key} AS o{number}" for number, owner in enumerate(owners)]
        none = [f"NULL::VARCHAR AS o{number}" for number in range(len(owners))]
        sides = [
            f"SELECT {key} AS key, {', '.join((digest + ' AS content', *more))} FROM {rows}"
            if rows
            else f"SELECT * FROM (SELECT '' AS key, {', '.join(('0::UBIGINT AS content', *none))})"
            " WHERE false"
            for rows, more in zip(scans, (names, ()), strict=True)
        ]
        owns = "".join(
            f", CASE WHEN n.key IS NULL THEN o.o{number} END AS o{number}"
            for number in range(len(owners))
        )
        return (
            "SELECT coalesce(n.key, o.key) AS key, CASE WHEN o.key IS NULL THEN 'came' WHEN n.key"
            f" IS NULL THEN 'went' ELSE 'changed' END AS change{owns} FROM ({sides[0]}) o FULL JOIN"
            f" ({sides[1]}) n ON o.key = n.key"
            " WHERE o.key IS NULL OR n.key IS NULL OR o.content <> n.content"
        )

    def _scan(self, view: View) -> str:
        if view.remote is None:
            return scan(view.files)
        return scan([self._files.add_file(view.remote.folder, name) for name in view.remote.names])

    def not_compared(self) -> str:
        """A line about columns that were not compared so far, "" for none."""
        shown = (
            f"{', '.join(names[:_SHOWN])}{' …' * (len(names) > _SHOWN)} ({why})"
            for why, names in self.left_out.items()
            if names
        )
        line = "; ".join(shown)
        return f"not compared: {line}" if line else ""

    def _leave_out(self, why: str, names: Iterable[str], *sides: Iterable[str]) -> set[str]:
        """Note columns that are not compared, of those that all sides have."""
        left = set(names).intersection(*sides)
        self.left_out[why] = sorted(left.union(self.left_out.get(why, ())))
        return left

    def _no_common_value(
        self, name: str, scans: Iterable[str], kinds: Iterable[Mapping[str, str]]
    ) -> bool:
        """Whether both sides have values in a column, and none of them in common."""
        if not all(name in kind for kind in kinds):
            return False
        column = _quoted(name)
        values = [f"SELECT {column} FROM {rows} WHERE {column} IS NOT NULL" for rows in scans]
        ((old, new, common),) = self.con.execute(
            f"SELECT EXISTS ({values[0]}), EXISTS ({values[1]}),"
            f" EXISTS ({' INTERSECT '.join(values)})"
        ).fetchall()
        return bool(old and new and not common)

    def _without_values(self, rows: str, names: Iterable[str]) -> set[str]:
        """The columns that hold nothing but null."""
        counted = ", ".join(f"count({_quoted(name)})" for name in names)
        (counts,) = self.con.execute(f"SELECT {counted} FROM {rows}").fetchall()
        return {name for name, n in zip(names, counts, strict=True) if not n}

    def _kinds(self, rows: str) -> dict[str, str]:
        described = self.con.execute(f"DESCRIBE FROM {rows}").fetchall()
        return {name: kind for name, kind, *_ in described}

    def _note_reasons(self, sources: set[str]) -> None:
        """The temporary table `reasons`: what the newer side says of each name, first removals."""
        self.con.execute(
            "CREATE OR REPLACE TEMP TABLE said"
            f" (source VARCHAR, name VARCHAR, why {_WHY}, place INT)"
        )
        for source in sorted(sources):
            for schema in ("clean", "release"):
                removed = self.new.get(f"{schema}.{tombstones_view(source)}")
                if removed is not None:
                    remote = removed.remote
                    self.con.register(
                        "removed",
                        remote.dataset.to_table() if remote else read_tombstones(removed.files[0]),
                    )
                    self._note(source, "'removed', reason, NULL, NULL", 0, "removed")
                    self.con.unregister("removed")
            for rank, verdict in enumerate(VERDICTS, 1):
                if (view := self.new.get(f"clean.{source}_{verdict}")) is not None:
                    columns = f"'{verdict}', reason, NULL, NULL"
                    if verdict == "rejected":
                        columns = "stage, reason, value, threshold"
                    self._note(source, columns, rank, scan(view.files))
            if (view := self.new.get("restored.missing")) is not None:
                missing = f"{scan(view.files)} WHERE source = '{source}'"
                self._note(source, "'missing', reason, NULL, NULL", 9, missing)
        self.con.execute(
            "CREATE OR REPLACE TEMP TABLE reasons AS FROM said"
            " QUALIFY row_number() OVER (PARTITION BY source, name ORDER BY place) = 1"
        )

    def _note(self, source: str, why: str, rank: int, rows: str) -> None:
        names = "stage", "reason", "value", "threshold"
        parts = zip(names, why.split(", "), strict=True)
        packed = ", ".join(f"{name} := {sql}::VARCHAR" for name, sql in parts)
        self.con.execute(
            f"INSERT INTO said SELECT '{source}', key, struct_pack({packed}), {rank} FROM {rows}"
        )


def _form_of(source: str, side: Mapping[str, View], other: Mapping[str, View]) -> str:
    """The schema in which a side's tables of a source are compared, "" where it has none."""
    names = {view_name(declared) for declared in tables_of(source)}
    mine, theirs = (
        [form for form in FORMS if any(f"{form}.{name}" in views for name in names)]
        for views in (side, other)
    )
    both = [form for form in mine if form in theirs]
    return next(iter(both or mine), "")


def _owners(declared: Table) -> list[Owner]:
    """The row itself, then what it belongs to: a video, a page, a comment or its post."""
    owners = []
    for source in SOURCES.values():
        for short, prefix in source.tables.items():
            column = table(f"{source.name}/{short}").key[0]
            if column in declared.names():
                key = f"'{prefix}' || {_quoted(column)}::VARCHAR"
                is_itself = declared.name == f"{source.name}/{short}"
                owners.append((not is_itself, short == source.main, Owner(source.name, key)))
    return [owner for *_, owner in sorted(owners, key=lambda ranked: ranked[:2])]


def _quoted(name: str) -> str:
    return f'"{name}"'
