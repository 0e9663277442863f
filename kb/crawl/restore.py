"""Released items of a source, as a job of `kb restore`: a crawl of their keys.

    restored/<source>/<table>/           the clean tables' columns, scores of models null
    restored/<source>/missing.parquet    what could not be restored, with the reason
    restored/<source>/.work              raw data and state of a crawl that has not finished

An item with a row, and one whose reason is final, is not asked for again without --again.
"""

import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.restore import (
    FAILED,
    FOREVER,
    MISSING,
    PURGED,
    WORK,
    MissingReason,
    RestoredTable,
    RestoreFolder,
    WantedContent,
)
from kb.core.cached_property import cached_property
from kb.core.context import Run
from kb.core.errors import GLOBAL_STOPS, NothingRead, Stopped
from kb.core.sources import SourceDeclaration
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart, PlanPhase
from kb.crawl.connector import Connector
from kb.crawl.job import crawl_source
from kb.schema.tables import table
from kb.store.atomic import write_text
from kb.store.layout import Layout, parquet_files
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.store.tables.partition import Shuffle
from kb.store.tables.reading import reading, state

_AGAIN = "again"  # in a work folder: everything is read again


class Outcome(NamedTuple):
    """What became of asked items: why they have no row, by prefix and key, `unlisted` ones listed
    only if they were asked for; and the keys of items that are not complete yet, as part of them
    failed or was not asked for.
    """

    reasons: Mapping[str, MissingReason]
    unlisted: Collection[str]
    incomplete: Collection[str] = ()


@dataclass(frozen=True)
class ItemRestore:
    """Restores the items whose keys a source's release names, and what belongs to them: rows of
    other tables with the same key. `clean` makes clean tables of raw answers.
    """

    run: Run
    content: WantedContent
    source: SourceDeclaration
    connector: Callable[[Run], Connector]
    clean: Callable[[Run, str], object]

    @property
    def key(self) -> str:
        """The column with the key of an item, in all tables."""
        return table(f"{self.source.name}/{self.source.main}").key[0]

    @property
    def tables(self) -> tuple[RestoredTable, ...]:
        """The tables in the order in which they are replaced, that of the items last."""
        name, main = self.source.name, self.source.main
        shorts = sorted(self.source.tables, key=lambda short: short == main)
        return tuple(RestoredTable(f"{name}/{short}", f"{short} ") for short in shorts)

    @property
    def folder(self) -> RestoreFolder:
        """The restored tables."""
        path = Layout(self.run.root).restored(self.source.name)
        return RestoreFolder(path, self.tables, self.key, "shared/missing", rows_per_bucket=10_000)

    @cached_property
    def keys(self) -> Collection[str]:
        """The keys of the wanted items."""
        folders = self.content.folders_of(self.source.name)
        return self.keys_in(
            [path for folder in folders for path in folder.shards(self.source.main)]
        )

    @cached_property
    def removed(self) -> set[str]:
        """What the releases or this data root list as removed."""
        own = tombstones.keys(self.run.root, self.source.name)
        return self.content.removed(self.source.name) | own

    @property
    def wanted(self) -> bool:
        return bool(self.keys)

    def check_settings(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """As `RestoreJob.check_settings`. Raises ProfileError without the source's section."""
        if self.wanted:
            self.run.profile.section(self.source.name)
        credential = self.source.credential
        return (*needed, credential) if credential and self.left() else needed

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`."""
        if not (left := self.left()):
            return PlanPart()
        asking = self.connector(replace(self.run, root=self.folder.path / WORK))
        asking.restrict(left, None)
        summary = asking.plan("restore")
        credential = self.source.credential
        key = self.run.settings.named(credential) if credential else "no key"
        phases = [PlanPhase(**phase) for phase in summary["phases"]]
        whom = f"{self.source.title}, {key}"
        return PlanPart([phase.asking(whom) for phase in phases], [str(summary["assumed"])])

    def left(self) -> list[str]:
        """The wanted items that have to be asked for, in order, as the crawl names them. Raises
        DamagedData.
        """
        known: set[str] = set()
        if not self.run.again:
            prefix = self.tables[-1].prefix
            missing = self.folder.missing().items()
            known.update(self.restored())
            known |= {
                name.removeprefix(prefix)
                for name, reason in missing
                if name.startswith(prefix) and reason.reason != FAILED
            }
        own = self.source.tables[self.source.main]
        left = (f"{own}{key}" for key in self.keys if key not in known)
        return [key for key in left if key not in self.removed]

    def restore(self) -> Summary:
        """As `RestoreJob.restore`. Raises MissingCredential, DamagedData."""
        run, place = self.run, self.folder.path / WORK
        if run.again and not (place / _AGAIN).exists():
            shutil.rmtree(place, ignore_errors=True)
        stopped: NothingRead | Stopped | None = None
        summary = Summary(command="restore", source=self.source.name, requests=0, units=0, failed=0)
        answered = False
        if left := self.left():
            place.mkdir(parents=True, exist_ok=True)
            if run.again:
                write_text(place / _AGAIN, "")
            try:
                summary |= self.crawl(left, place)
            except GLOBAL_STOPS:
                raise
            except (NothingRead, Stopped) as error:
                summary |= error.summary or {}
                stopped = error
            answered = bool(summary.get("crawled_in_all") or summary.get("missing"))
        if answered:
            self.clean(replace(run, root=place, limit=None, again=False), self.source.name)
        if answered or self._has_removed():
            self._merge(place)
        if not stopped and not summary["failed"]:
            shutil.rmtree(place, ignore_errors=True)
        summary |= self.folder.counts()
        if stopped is not None:
            stopped.summary = summary
            raise stopped
        return summary

    def missing(self) -> pa.Table | None:
        """As `RestoreJob.missing`."""
        path = self.folder.path / MISSING
        return parquet.read_table(path) if path.is_file() else None

    def crawl(self, left: list[str], place: Path) -> Summary:
        """Ask for what is left: raw answers in the work folder. Raises Stopped."""
        asking = self.connector(self.run)
        asking.restrict(left, None)
        crawled = self.source, asking, "restore"
        return crawl_source(self.run, *crawled, place=place, removed=self.removed)

    def restored(self) -> Collection[str]:
        """The keys of items that are restored. Raises DamagedData."""
        return self.keys_in(parquet_files(self.folder.path / self.source.main))

    def outcome(self, place: Path) -> Outcome:
        """What became of the items of a work folder."""
        reasons: dict[str, MissingReason] = {}
        incomplete, own = set(), self.tables[-1].prefix
        for kind, name, status in self._items(place):
            key = self.source.table_of(name)[1]
            if status == "skipped" and self.source.nouns[kind] == self.source.counted:
                reasons.setdefault(f"{own}{key}", MissingReason("missing"))
            elif status == "error":
                reasons[f"{own}{key}"] = MissingReason(FAILED)
            if status not in ("done", "skipped"):
                incomplete.add(key)
        removed = {" ".join(self.source.table_of(name)) for name in self.removed}
        reasons |= dict.fromkeys(removed, MissingReason(PURGED, FOREVER))
        return Outcome(reasons, removed - {f"{own}{key}" for key in self.keys}, incomplete)

    def _items(self, place: Path) -> Iterator[tuple[str, str, str]]:
        """(kind, name, status) of what a work folder's crawl knows, where there was one."""
        path = Layout(place).state(self.source.name)
        if path.is_file():
            with state(path) as frontier:
                for kind in self.source.nouns:
                    yield from ((kind, name, status) for name, status, *_ in frontier.items(kind))

    def keys_in(self, files: Sequence[Path]) -> Collection[str]:
        """The keys of items in files of the main table. Raises DamagedData."""
        with reading(files):
            columns = [parquet.read_table(path, columns=[self.key])[self.key] for path in files]
        return dict.fromkeys(str(key) for keys in columns for key in keys.to_pylist())

    def _has_removed(self) -> bool:
        """Whether removed items are in the tables, or wanted ones are not listed yet."""
        own = self.source.tables[self.source.main]
        prefix = self.tables[-1].prefix
        listed = {name for name, reason in self.folder.missing().items() if reason.reason == PURGED}
        unlisted = (key for key in self.keys if f"{prefix}{key}" not in listed)
        return not self.removed.isdisjoint(f"{own}{key}" for key in (*self.restored(), *unlisted))

    def _merge(self, place: Path) -> None:
        """Clean tables of the work folder → the restored ones, and the reasons of the rest."""
        clean, scratch, folder = Layout(place), place / "rows", self.folder
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        outcome = self.outcome(place)
        fresh = {
            restored: parquet_files(clean.clean(*restored.name.split("/")))
            for restored in self.tables
        }
        items = sum(parquet.footer(path).num_rows for path in fresh[self.tables[-1]])
        buckets = folder.buckets(items)
        incomplete = pa.array(sorted(outcome.incomplete), pa.string())
        for restored, paths in fresh.items():
            with Shuffle(scratch, f"new-{restored.declared.short}", buckets) as shuffle:
                for path in paths:
                    rows = parquet.read_table(path)
                    keys = rows[self.key].cast(pa.string())
                    rows = rows.filter(pc.invert(pc.is_in(keys, value_set=incomplete)))
                    shuffle.add_rows(rows, rows[self.key])
        folder.merge(
            scratch, buckets, outcome.reasons, unlisted=outcome.unlisted, finish=self._of_items
        )

    def _of_items(self, rows: dict[str, pa.Table]) -> dict[str, pa.Table]:
        """The rows of a bucket whose item is there."""
        items = rows[self.tables[-1].name][self.key].combine_chunks()
        return {
            name: part.filter(pc.is_in(part[self.key], value_set=items))
            for name, part in rows.items()
        }
