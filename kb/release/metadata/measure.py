"""Measures a release folder: the figures of its card, datasheet and metadata.

Only counts, extremes and medians over all of the data: the same data gives the same figures.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

from duckdb import DuckDBPyConnection

from kb.artifacts import manifest
from kb.artifacts.card_answers import CardAnswer
from kb.artifacts.release_folder import ReleasedTable, ReleaseFolder
from kb.core.context import Run
from kb.core.licences import KNOWN
from kb.core.sources import PUBLISHED, SOURCES, made_of
from kb.release.gate.contents import personal_counts
from kb.schema import Column, Table, released_tables
from kb.schema.tables import tables_of
from kb.store.layout import VERDICTS, Layout, parquet_files
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.store.tables import database, parquet
from kb.store.tables.checksums import digest
from kb.store.tables.reading import SANDBOX_MODEL, filtered, scan

Span = tuple[datetime, datetime]


@dataclass(frozen=True, slots=True)
class ColumnFacts:
    """One column: `low`, `middle` (median) and `high` of numbers and times,
    `top` values of categories.
    """

    column: Column
    nulls: int
    low: Any = None
    middle: Any = None
    high: Any = None
    top: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class DataFile:
    """A data file: bytes, rows (None when it is no table) and SHA-256."""

    name: str
    size: int
    rows: int | None
    sha256: str


@dataclass(frozen=True, slots=True)
class SplitFacts:
    """A split of a table for training, all of it where it has none: its files, rows, and the bytes
    that these take in memory.
    """

    name: str
    glob: str
    rows: int
    arrow_bytes: int


@dataclass(frozen=True, slots=True)
class TableFacts:
    """One table of the folder."""

    table: Table
    rows: int
    files: tuple[DataFile, ...]
    columns: tuple[ColumnFacts, ...]
    splits: tuple[SplitFacts, ...]

    @property
    def arrow_bytes(self) -> int:
        return sum(split.arrow_bytes for split in self.splits)

    @property
    def glob(self) -> str:
        """What names all of its files."""
        return "*-of-*.parquet" if self.table.split_by else f"{self.table.short}-*.parquet"

    @property
    def size(self) -> int:
        return sum(file.size for file in self.files)


@dataclass(frozen=True, slots=True)
class Way:
    """A way by which rows of a source came, as the data root records it. `counts` are a table, its
    rows that came so, and all of its rows; `undated` of them don't say when they were read.
    """

    source: str
    name: str
    counts: tuple[tuple[str, int, int], ...] = ()
    read: Span | None = None
    undated: int = 0


@dataclass(frozen=True, slots=True)
class Facts:
    """All of a folder. `built` is SOURCE_DATE_EPOCH, None without it; `read` and `made` are dates
    of reading and of the material itself; `rejected` is (stage, reason) → rows.

    `unscored`: the toxicity of no text was scored. `gaps` are sentences on what these very rows
    lack, `quality` on how good they are, `answers` what they say to some questions.
    """

    source: str
    name: str  # of the folder, which is the source's but for selections with one of their own
    built: datetime | None
    tables: tuple[TableFacts, ...]
    others: tuple[DataFile, ...]
    licence: str
    licences: tuple[tuple[str, int], ...]
    read: Span | None
    made: Span | None
    rejected: tuple[tuple[str, str, int], ...]
    failed: int
    pending: int
    models: tuple[tuple[str, str, str], ...]
    tombstones: int
    ways: tuple[Way, ...] = ()
    unscored: bool = False
    personal: dict[tuple[str, str], tuple[int, int, int]] = field(default_factory=dict)
    gaps: tuple[str, ...] = ()
    quality: tuple[str, ...] = ()
    answers: tuple[CardAnswer, ...] = ()

    @property
    def rows(self) -> int:
        return sum(table.rows for table in self.tables)

    @property
    def size(self) -> int:
        return sum(table.size for table in self.tables) + sum(file.size for file in self.others)

    @property
    def sandbox(self) -> bool:
        """Whether the sandbox's tiny model scored any of it."""
        return any(model == SANDBOX_MODEL for model, _, _ in self.models)


_TOPS = 8
# DuckDB hands out times with a zone only where pytz is installed.
_LOW, _HIGH = "min({} AT TIME ZONE 'UTC')", "max({} AT TIME ZONE 'UTC')"


class MeasuredPublication(Protocol):
    """What is published, and says what its rows are like."""

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        """Sentences on what the released rows lack."""

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        """Sentences on how good they are."""

    def answers(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> Sequence[CardAnswer]:
        """Questions that they answer, with the answers."""


def measure(run: Run, folder: ReleaseFolder, published: MeasuredPublication) -> Facts:
    """Read the folder, and what clean/ says about how it came to be."""
    shards = [shard for part in folder.parts for shard in part.shards]
    verdicts = [manifest.rows(run.root, f"{folder.source}/{verdict}") for verdict in VERDICTS]
    asked = [*shards, *chain.from_iterable(verdicts)]
    parquet.verify_files(*asked)
    with database.over(asked, run.root) as con:
        return _facts(con, run, folder, published)


def _facts(
    con: DuckDBPyConnection, run: Run, folder: ReleaseFolder, published: MeasuredPublication
) -> Facts:
    tables = tuple(_table(con, part) for part in folder.parts)
    read = _span(con, _times(folder, "fetched_at")) or _span(
        con, _read_times(run.root, made_of(folder.source))
    )
    of, sources, built = (
        PUBLISHED[folder.source],
        made_of(folder.source),
        run.settings.source_date_epoch,
    )
    made = _span(con, _times(folder, "published_at", "created_utc", "revision_timestamp"))
    return Facts(
        source=folder.source,
        name=folder.name,
        built=None if built is None else datetime.fromtimestamp(built, UTC),
        tables=tables,
        others=tuple(
            DataFile(path.name, path.stat().st_size, None, digest(path)) for path in folder.others
        ),
        licence=folder_licence(run, folder),
        licences=licences(folder, *of.licensed),
        read=read,
        made=made,
        rejected=_rejected(con, run.root, folder.source),
        failed=_count(Layout(run.root).clean(folder.source, "failed")),
        pending=_count(Layout(run.root).clean(folder.source, "pending")),
        models=models(run.root, folder.source),
        tombstones=sum(len(tombstones.keys(run.root, name)) for name in sources),
        ways=tuple(way for name in sources for way in _ways(con, run.root, name)),
        unscored=not run.profile.toxicity.on
        or any("toxicity" in filtered(run.root, name) for name in sources),
        personal=personal_counts(folder),
        gaps=tuple(published.gaps(con, run.root, folder)),
        quality=published.quality(con, run.root, folder),
        answers=tuple(published.answers(con, run.root, folder)),
    )


def folder_licence(run: Run, folder: ReleaseFolder) -> str:
    """SPDX id of the folder's licence: the wiki's own where its pages name one that is known, else
    the profile's; empty when neither gives one.
    """
    of = PUBLISHED[folder.source]
    if of.part_of:
        return of.licence
    if of.licensed:
        for name, _ in licences(folder, of.main):
            if name in KNOWN:
                return name
    return run.profile.release.licence_of(folder.source)


def licences(folder: ReleaseFolder, *tables: str) -> tuple[tuple[str, int], ...]:
    """Licences that the rows of these tables name, the most frequent first within each."""
    counts: dict[str, int] = {}
    for short in tables:
        for part in folder.parts:
            if part.table.short == short and "license" in part.table.names(released=True):
                with database.asking() as con:
                    rows = con.execute(
                        f"SELECT license, count(*) AS n FROM {scan(part.shards)}"
                        " WHERE license IS NOT NULL GROUP BY 1 ORDER BY n DESC, 1"
                    ).fetchall()
                for name, n in rows:
                    counts[name] = counts.get(name, 0) + n
    return tuple(counts.items())


def models(root: Path, source: str) -> tuple[tuple[str, str, str], ...]:
    """(model, revision, precision) of the scores that the source's last filter decided by; () when
    it had none.

    Of a text's precisions the exact one decides. A clean folder that doesn't say its model: every
    model's scores.
    """
    # Pairs, links and wiki images carry no scores of their own: what they name was scored.
    scored_by = [model for of in made_of(source) for model in _models(root, of)]
    return tuple(sorted(set(scored_by)))


def _models(root: Path, source: str) -> tuple[tuple[str, str, str], ...]:
    files = [str(file) for file in parquet_files(Layout(root).annotations(source))]
    filter_note = filtered(root, source)
    if not files or "toxicity" in filter_note:  # "not scored"
        return ()
    parquet.verify_files(*files)
    with database.asking() as con:
        if "model" not in filter_note:
            return tuple(
                con.execute(
                    "SELECT DISTINCT model, revision, precision FROM read_parquet(?) ORDER BY ALL",
                    [files],
                ).fetchall()
            )
        rank = "CASE precision WHEN 'fp32' THEN 0 WHEN 'bf16' THEN 1 ELSE 2 END"
        rows = con.execute(
            f"SELECT DISTINCT model, revision, arg_min(precision, {rank}) FROM read_parquet(?)"
            " WHERE model = ? AND revision = ? GROUP BY text_hash, model, revision ORDER BY ALL",
            [files, filter_note["model"], filter_note["revision"]],
        )
        return tuple(rows.fetchall())


def _ways(con: DuckDBPyConnection, root: Path, source: str) -> Iterator[Way]:
    """How the clean rows of a source came: those of its ways that left a record here."""
    at, of = Layout(root), SOURCES[source]
    if not at.rows(f"{source}/{of.main}"):
        return
    for name, recorded in of.ways.items():
        if recorded.raw:
            answers = bool(rawlog.segments(root, source, recorded.raw))
            if answers == recorded.absent or not at.raw(source).is_dir():
                continue
        counts, known, undated = [], [], 0
        for declared in sorted(
            tables_of(source), key=lambda table: (table.short != of.main, table.name)
        ):
            files = at.rows(declared.name)
            if not files or not recorded.column or recorded.column not in declared.names():
                continue
            came = f"FILTER ({recorded.column} = '{recorded.value}')"
            total, n, dated, low, high = con.execute(
                f"SELECT count(*), count(*) {came}, count(fetched_at) {came},"
                f" {_LOW.format('fetched_at')} {came}, {_HIGH.format('fetched_at')} {came}"
                f" FROM {scan(files)}"
            ).fetchall()[0]
            if n:
                counts.append((declared.short, n, total))
                known += [time.replace(tzinfo=UTC) for time in (low, high) if time is not None]
                undated += n - dated
        if counts or recorded.raw:
            read = (min(known), max(known)) if known else None
            yield Way(source, name, tuple(counts), read, undated)


def _table(con: DuckDBPyConnection, part: ReleasedTable) -> TableFacts:
    files = tuple(
        DataFile(shard.name, shard.stat().st_size, parquet.footer(shard).num_rows, digest(shard))
        for shard in part.shards
    )
    released = [column for column in part.table.columns if column.released]
    columns = tuple(_columns(con, scan(part.shards), released))
    rows = sum(file.rows or 0 for file in files)
    splits = []
    for stem in part.table.stems:
        mine = [shard for shard in part.shards if shard.name.startswith(f"{stem}-")]
        name = stem if part.table.split_by else "train"
        own = sum(parquet.footer(shard).num_rows for shard in mine)
        size = sum(map(_arrow_bytes, mine))
        splits.append(SplitFacts(name, f"{stem}-*-of-*.parquet", own, size))
    return TableFacts(part.table, rows, files, columns, tuple(splits))


def _arrow_bytes(shard: Path) -> int:
    """What its row groups take in memory, one after the other."""
    with parquet.open_file(shard) as file:
        return sum(file.read_row_group(n).nbytes for n in range(file.num_row_groups))


def _columns(
    con: DuckDBPyConnection, rows: str, columns: Sequence[Column]
) -> Iterator[ColumnFacts]:
    """What each column holds: one pass counts and finds the ends; what has to hold a column's
    values in memory (medians, the most frequent ones) is asked column by column.
    """
    asked = ", ".join(map(_counted, columns))
    counts = con.execute(f"SELECT {asked} FROM {rows}").fetchall()[0]
    for column, nulls, low, high in zip(columns, *(counts[at::3] for at in range(3)), strict=True):
        if _is_number(column):
            ends = [end if end is None else end + 0 for end in (low, high)]  # no minus zero
            sql = f'SELECT quantile_disc("{column.name}", 0.5) FROM {rows}'
            ((median,),) = con.execute(sql).fetchall()
            yield ColumnFacts(column, nulls, ends[0], median, ends[1])
        elif _is_time(column):
            times = [end and end.replace(tzinfo=UTC) for end in (low, high)]
            yield ColumnFacts(column, nulls, times[0], None, times[1])
        elif column.dictionary or column.type == "bool":
            top = con.execute(
                f'SELECT "{column.name}"::VARCHAR, count(*) AS n FROM {rows}'
                f' WHERE "{column.name}" IS NOT NULL GROUP BY 1 ORDER BY n DESC, 1 LIMIT {_TOPS}'
            )
            yield ColumnFacts(column, nulls, top=tuple(top.fetchall()))
        else:
            yield ColumnFacts(column, nulls)


def _is_number(column: Column) -> bool:
    return column.type.startswith(("int", "float")) and not column.name.endswith("_id")


def _is_time(column: Column) -> bool:
    return column.type.startswith(("timestamp", "date"))


def _counted(column: Column) -> str:
    """Three expressions: rows without a value, the lowest and the highest one."""
    low, high = "NULL", "NULL"
    if _is_number(column):
        low, high = "min({})", "max({})"
    elif _is_time(column):
        low, high = _LOW, _HIGH
    name = f'"{column.name}"'
    return f"count(*) - count({name}), {low.format(name)}, {high.format(name)}"


def _span(con: DuckDBPyConnection, columns: Iterable[tuple[Sequence[Path], str]]) -> Span | None:
    """The earliest and the latest time in these columns, each given with its files."""
    known = []
    for files, name in columns:
        low, high = con.execute(
            f"SELECT {_LOW.format(name)}, {_HIGH.format(name)} FROM {scan(files)}"
        ).fetchall()[0]
        if low is not None:
            known += [low.replace(tzinfo=UTC), high.replace(tzinfo=UTC)]
    return (min(known), max(known)) if known else None


def _times(folder: ReleaseFolder, *names: str) -> Iterator[tuple[Sequence[Path], str]]:
    """The columns of these names in the folder."""
    for part in folder.parts:
        for name in names:
            if name in part.table.names(released=True):
                yield part.shards, name


def _read_times(root: Path, sources: Iterable[str]) -> Iterator[tuple[Sequence[Path], str]]:
    """When the rows of sources were read, by their tables that say so."""
    for source in sources:
        for declared in released_tables(source):
            files = Layout(root).rows(declared.name)
            if files and "fetched_at" in declared.names():
                yield files, "fetched_at"


def _rejected(con: DuckDBPyConnection, root: Path, source: str) -> tuple[tuple[str, str, int], ...]:
    files = Layout(root).rows(f"{source}/rejected")
    if not files:
        return ()
    rows = con.execute(
        "SELECT stage, reason, count(*) AS n FROM read_parquet(?) GROUP BY ALL"
        " ORDER BY stage, n DESC, reason",
        [[str(file) for file in files]],
    )
    return tuple(rows.fetchall())


def _count(folder: Path) -> int:
    return sum(parquet.footer(file).num_rows for file in parquet_files(folder))
