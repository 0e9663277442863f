"""The frame of everything that brings released content back by its ids.

    folder/<table>/part-*.parquet    restored rows of each declared table
    folder/missing.parquet           what was asked for and has no row, with the reason
    folder/.work…                    raw answers of a run that has not finished

A restore job takes the wanted ids from release folders, collects raw answers in a work folder and
adds them to the tables. The newest row of a key wins. A final reason (deleted, removed, purged …)
removes the row, and only an answer that was read later brings it back; any other reason (failed,
forbidden, not in these dumps …) keeps an older row.

The frame needs the store and no crawl, so sources and `kb.pairs` build on it alike. A source says
how raw answers become rows; the merge, the reasons and the list of what is missing are here.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.errors import SettingError
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart
from kb.schema.tables import Table, table
from kb.store.atomic import replacing_folder, settle_folder
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database, parquet
from kb.store.tables.columns import newest
from kb.store.tables.partition import Shuffle
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import write_table

MISSING, WORK = "missing.parquet", ".work"
FAILED, PURGED = "failed", "purged"
# The last word of the service or the user; "none": the video no longer has a transcript.
FINAL = ("deleted", "removed", "missing", PURGED, "none")
FOREVER = datetime(9999, 1, 1, tzinfo=UTC)  # the time of a reason that no answer overrides
_BATCH, _IDS = 65_536, 200_000  # rows read at a time, ids written at a time


class WantedContent(NamedTuple):
    """Release folders to restore (`chosen`), out of `folders`, whose tombstones all count; `dumps`
    are files to read instead of asking a service.
    """

    chosen: Sequence[ReleaseFolder]
    folders: Sequence[ReleaseFolder]
    dumps: Sequence[Path] = ()

    def folders_of(self, source: str) -> list[ReleaseFolder]:
        """The chosen folders of a source."""
        return [folder for folder in self.chosen if folder.source == source]

    def removed(self, *sources: str) -> set[str]:
        """Keys that the releases of these sources list as removed. Raises DamagedData."""
        return {
            key for folder in self.folders if folder.source in sources for key in folder.removed()
        }


def choose(folders: Sequence[ReleaseFolder], only: str | None) -> WantedContent:
    """The folders of the source `only`, or all of them. Raises SettingError."""
    chosen = [folder for folder in folders if only is None or folder.source == only]
    if only and not chosen:
        raise SettingError(
            f"--only {only}: none of the folders belongs to {only}",
            hint=f"they belong to {', '.join(sorted({folder.source for folder in folders}))}",
        )
    return WantedContent(chosen, folders)


class RestoreJob(Protocol):
    """What one room brings back; a job whose `wanted` is false only lists what is missing."""

    @property
    def wanted(self) -> bool:
        """Whether the release folders name any of it."""

    def check_settings(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """`needed` and the settings of this job. Raises SettingError, MissingCredential."""

    def plan(self) -> PlanPart:
        """What it would ask for, and from whom. Sends and writes nothing."""

    def restore(self) -> Summary:
        """Bring it back. Raises Stopped with its summary; the same command resumes."""

    def missing(self) -> pa.Table | None:
        """Rows of `shared/missing`, from all runs so far."""


def write_missing(root: Path, jobs: Iterable[RestoreJob]) -> int:
    """One table of what all jobs could not restore → restored/missing.parquet; its rows."""
    declared = table("shared/missing").names()
    schema = pa.schema([(name, pa.string()) for name in declared])
    rows = [missing.select(declared).cast(schema) for job in jobs if (missing := job.missing())]
    listed = pa.concat_tables([schema.empty_table(), *rows])
    write_table(Layout(root).restored() / MISSING, listed, "shared/missing")
    return listed.num_rows


class MissingReason(NamedTuple):
    """Why something has no row; `at`: when the source said so, None where it gave no time."""

    reason: str
    at: datetime | None = None

    @property
    def final(self) -> bool:
        """Whether it removes a row that an earlier run restored."""
        return self.reason in FINAL


Reasons = Mapping[str, MissingReason]  # by prefix and key, as `RestoredTable.prefix` says


class RestoredTable(NamedTuple):
    """A declared table of restored rows; `prefix` before its key makes a name in `Reasons`."""

    name: str
    prefix: str

    @property
    def declared(self) -> Table:
        """What the schema says of it."""
        return table(self.name)


def fresh_rows(scratch: Path, bucket: int, short: str) -> Path:
    """The file of new rows of a table, in one bucket of a scratch folder."""
    return scratch / str(bucket) / f"new-{short}.arrow"


@dataclass(frozen=True)
class RestoreFolder:
    """A folder of restored tables. Rows that belong together agree in the column `group`.

    `missing_table` declares missing.parquet. With its column `part` a prefix is that and a space.
    """

    path: Path
    tables: tuple[RestoredTable, ...]
    group: str
    missing_table: str
    rows_per_bucket: int

    def settle(self) -> None:
        """Finish or undo the replacement of a table that a killed run had begun."""
        for restored in self.tables:
            settle_folder(self.path / restored.declared.short)

    def counts(self) -> dict[str, int]:
        """Rows of each table. Raises DamagedData."""
        sums = {}
        for restored in self.tables:
            files = parquet_files(self.path / restored.declared.short)
            with reading(files):
                sums[restored.declared.short] = sum(parquet.footer(path).num_rows for path in files)
        return sums

    def buckets(self, expected: int) -> int:
        """How many buckets hold the restored rows and so many more."""
        return 1 + (expected + sum(self.counts().values())) // self.rows_per_bucket

    def missing(self) -> dict[str, MissingReason]:
        """The reasons that earlier runs listed. Raises DamagedData."""
        path = self.path / MISSING
        if not path.exists():
            return {}
        with reading([path]):
            rows = parquet.read_table(path)
        columns = [cast("list[str]", rows[name].to_pylist()) for name in ("key", "reason")]
        times: list[Any] = [None] * rows.num_rows
        if "part" in rows.column_names:
            parts = rows["part"].to_pylist()
            columns[0] = [f"{part} {key}" for part, key in zip(parts, columns[0], strict=True)]
        else:
            times = rows["said_at"].to_pylist()
        return {key: MissingReason(why, at) for key, why, at in zip(*columns, times, strict=True)}

    def merge(
        self,
        scratch: Path,
        buckets: int,
        reasons: Reasons,
        asked: Iterable[str] = (),
        *,
        newer: bool = True,
        unlisted: Collection[str] = (),
        otherwise: str = "missing",
        finish: Callable[[dict[str, pa.Table]], dict[str, pa.Table]] = lambda rows: rows,
    ) -> dict[str, int]:
        """Add the fresh rows in `scratch` and `reasons` to the tables; how many rows each has then,
        missing.parquet too.

        `newer`: these answers were read after all that is in the tables. `asked` names are listed
        as missing where they have no row, for the reason `otherwise` where none is known;
        `unlisted` ones only if they were asked for. `finish` computes columns from all rows of a
        bucket. Each table is replaced atomically, in the order of `tables`: a key that the last one
        has is in all of them. After a kill, the same call gives the same result. Raises
        DamagedData, DiskFull.
        """
        before = self.missing()
        self._partition(scratch, buckets)
        final_before, final_now = _final(before), _final(reasons)
        purged = _final({key: reason for key, reason in reasons.items() if reason.at == FOREVER})
        with ExitStack() as folders:
            made = {
                restored.name: folders.enter_context(
                    replacing_folder(self.path / restored.declared.short)
                )
                for restored in reversed(self.tables)  # they are replaced in the opposite order
            }
            counts = {restored.declared.short: 0 for restored in self.tables}
            for bucket in range(buckets):
                rows = {}
                for restored in self.tables:
                    fresh = _without(_fresh(restored, scratch, bucket), restored, purged)
                    old = _restored(restored, scratch, bucket, fresh)
                    if not newer:
                        fresh = _without(fresh, restored, final_before, unless_later=True)
                    old = _without(old, restored, final_now, unless_later=not newer)
                    by = ["fetched_at"] if "fetched_at" in fresh.column_names else []
                    key = [*restored.declared.key]
                    rows[restored.name] = newest(pa.concat_tables([old, fresh]), key, by)
                for name, merged in finish(rows).items():
                    if merged.num_rows or not bucket:  # the first part exists even without rows
                        write_table(made[name] / f"part-{bucket:05d}.parquet", merged, name)
                        counts[table(name).short] += merged.num_rows
            known = _newest_reasons(before, reasons, newer=newer)
            lost = self._missing_rows(scratch, made, asked, known, unlisted, otherwise)
            write_table(self.path / MISSING, lost, self.missing_table)
        return {**counts, MISSING: lost.num_rows}

    def _partition(self, scratch: Path, buckets: int) -> None:
        """Restored rows → `scratch/<bucket>/old-<table>.arrow`, by group."""
        for restored in self.tables:
            short = restored.declared.short
            parts = parquet_files(self.path / short)
            with Shuffle(scratch, f"old-{short}", buckets) as shuffle, reading(parts):
                for path in parts:
                    for batch in parquet.open_file(path).iter_batches(_BATCH):
                        rows = pa.Table.from_batches([batch])
                        shuffle.add_rows(rows, rows[self.group])

    def _missing_rows(
        self,
        scratch: Path,
        made: Mapping[str, Path],
        asked: Iterable[str],
        reasons: Reasons,
        unlisted: Collection[str],
        otherwise: str,
    ) -> pa.Table:
        """What has no row and was asked for or has a reason. The asked names stay on disk."""
        path = scratch / "asked.parquet"
        names = iter(asked)
        with parquet.writing(path, pa.schema([("key", pa.string())])) as file:
            while part := list(islice(names, _IDS)):
                file.write_batch(pa.record_batch({"key": pa.array(part, pa.string())}))
        present = {
            restored: [str(file) for file in made[restored.name].iterdir()]
            for restored in self.tables
        }
        rows = " UNION ALL ".join(
            f"SELECT '{kept.prefix}' || {kept.declared.key[0]} AS key FROM read_parquet(${number})"
            for number, kept in enumerate(present, 2)
        )
        times = [None if reason.at == FOREVER else reason.at for reason in reasons.values()]
        known = pa.table(
            {
                "key": pa.array(reasons.keys(), pa.string()),
                "reason": pa.array([reason.reason for reason in reasons.values()], pa.string()),
                "said_at": pa.array(times, pa.timestamp("us", "UTC")),
                "listed": pa.array([key not in unlisted for key in reasons], pa.bool_()),
            }
        )
        files = [path, *(Path(file) for paths in present.values() for file in paths)]
        with database.over(files, scratch, memory="1GB") as con:
            con.register("reasons", known)
            lost: pa.Table = con.sql(
                f"WITH present AS ({rows}), asked AS ("
                " SELECT key FROM read_parquet($1)"
                " UNION SELECT key FROM reasons WHERE listed)"
                f" SELECT key, coalesce(reason, ${2 + len(present)}) AS reason, said_at"
                " FROM asked ANTI JOIN present USING (key) LEFT JOIN reasons USING (key)",
                params=[str(path), *present.values(), otherwise],
            ).to_arrow_table()
        declared = table(self.missing_table)
        if "part" not in declared.names():
            return lost
        names_ = pc.split_pattern(lost["key"], " ", max_splits=1)
        source = pa.array([self.tables[0].declared.source] * lost.num_rows, pa.string())
        return pa.table(
            {
                "source": source,
                "part": pc.list_element(names_, 0),
                "key": pc.list_element(names_, 1),
                "reason": lost["reason"],
            }
        )


def _fresh(restored: RestoredTable, scratch: Path, bucket: int) -> pa.Table:
    """The new rows of a bucket."""
    path = fresh_rows(scratch, bucket, restored.declared.short)
    if not path.exists():
        return restored.declared.arrow().empty_table()
    with pa.ipc.open_file(str(path)) as file:
        return file.read_all()


def _restored(restored: RestoredTable, scratch: Path, bucket: int, like: pa.Table) -> pa.Table:
    """The rows of a bucket that earlier runs restored, with the columns of `like`: null where an
    older version did not have one yet.
    """
    path = scratch / str(bucket) / f"old-{restored.declared.short}.arrow"
    if not path.exists():
        return like.slice(0, 0)
    with pa.ipc.open_file(str(path)) as file:
        rows = file.read_all()
    for name in set(like.column_names) - set(rows.column_names):
        rows = rows.append_column(name, pa.nulls(rows.num_rows))
    return rows.select(like.column_names).cast(like.schema)


def _final(reasons: Reasons) -> pa.Table:
    """Names with a final reason, and its time."""
    rows = [(key, reason.at) for key, reason in reasons.items() if reason.final]
    times = pa.array([at for _, at in rows], pa.timestamp("us", "UTC"))
    return pa.table({"key": pa.array([key for key, _ in rows], pa.string()), "at": times})


def _without(
    rows: pa.Table, restored: RestoredTable, final: pa.Table, *, unless_later: bool = False
) -> pa.Table:
    """The rows without a final reason; with `unless_later` also those read after it was given."""
    named = final.filter(pc.starts_with(final["key"], restored.prefix))
    keys = pc.utf8_slice_codeunits(named["key"], len(restored.prefix)).combine_chunks()
    place = pc.index_in(rows[restored.declared.key[0]].cast(pa.string()), value_set=keys)
    kept = pc.is_null(place)
    if unless_later:
        later = pc.greater(rows["fetched_at"], named["at"].combine_chunks().take(place))
        kept = pc.or_(kept, pc.fill_null(later, False))
    return rows.filter(kept)


def _newest_reasons(old: Reasons, new: Reasons, *, newer: bool) -> Reasons:
    """Both together: only a later final reason replaces a final one."""
    known = {**old, **new}
    for key, before in old.items():
        now = known[key]
        if before.final and not (now.final and (newer or _is_later(now, before))):
            known[key] = before
    return known


def _is_later(reason: MissingReason, other: MissingReason) -> bool:
    """Without a time a reason is as late as can be: no answer is known to be newer."""
    if reason.at == FOREVER:
        return True
    return other.at is not None and (reason.at is None or reason.at > other.at)
