"""Videos and transcripts of released folders, as a job of `kb restore`.

    restored/youtube/videos, transcripts     the clean tables' columns, scores of models null
    restored/youtube/missing.parquet         what could not be restored, with the reason
    restored/youtube/.work                   raw data and state of a crawl that has not finished

A video with a row, and one whose reason is final, is not asked for again without --again.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

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
from kb.core.errors import GLOBAL_STOPS, Stopped
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart
from kb.crawl.job import work
from kb.schema.video_facts import NOT_PUBLIC
from kb.store.atomic import write_text
from kb.store.layout import Layout, parquet_files
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.store.tables.partition import Shuffle
from kb.store.tables.reading import reading
from kb.youtube.crawl.connector import YouTubeConnector
from kb.youtube.plan import REQUESTS_A_TRANSCRIPT, phases_of_known
from kb.youtube.section import YouTubeSection

VIDEO, TRANSCRIPT = "video ", "transcript "  # prefixes of names in missing.parquet
TABLES = (
    RestoredTable("youtube/transcripts", TRANSCRIPT),
    RestoredTable("youtube/videos", VIDEO),
)
NONE, UNKNOWN = "none", "unknown"  # kinds of a transcript: the video has none, or reading it failed
_AGAIN = "again"  # in a work folder: everything is read again
_COLUMNS = ("video_id", "transcript_kind")


@dataclass(frozen=True)
class VideoRestore:
    """Restores videos of released tables and pairs; `clean` makes clean tables of raw answers."""

    run: Run
    content: WantedContent
    clean: Callable[[Run], object]

    @property
    def folder(self) -> RestoreFolder:
        """The restored tables."""
        path = Layout(self.run.root).restored("youtube")
        return RestoreFolder(path, TABLES, "video_id", "shared/missing", rows_per_bucket=10_000)

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Each wanted video, and the kind of transcript it was released with."""
        kinds: dict[str, str] = {}
        for one in self.content.chosen:
            for path in (*one.shards("videos"), *one.shards("pairs")):
                with reading([path]):
                    kinds |= _kinds(path)
        return kinds

    @cached_property
    def removed(self) -> set[str]:
        """Videos that the releases or this data root list as removed."""
        own = tombstones.keys(self.run.root, "youtube")
        return self.content.removed("youtube", "pairs") | own

    @property
    def wanted(self) -> bool:
        return bool(self.kinds)

    def check(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """As `RestoreJob.check`. Raises ProfileError without [youtube]."""
        if self.wanted:
            self.run.profile.section(YouTubeSection)
        return (*needed, "youtube_api_key") if self.left() else needed

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`."""
        if not (left := self.left()):
            return PlanPart()
        videos, transcripts = phases_of_known(self.run, len(left))
        key = self.run.settings.named("youtube_api_key")
        phases = [videos.of(f"YouTube's Data API, {key}"), transcripts.of("youtube.com, no key")]
        return PlanPart(phases, [f"{REQUESTS_A_TRANSCRIPT} requests a transcript"])

    def left(self) -> list[str]:
        """The wanted videos that have to be asked for, in order. Raises DamagedData."""
        known = {*self.removed}
        if not self.run.again:
            known |= {key for key, kind in self._restored().items() if kind != UNKNOWN}
            known |= {
                name.removeprefix(VIDEO)
                for name, one in self.folder.missing().items()
                if name.startswith(VIDEO) and one.reason != FAILED
            }
        return [key for key in self.kinds if key not in known]

    def restore(self) -> Summary:
        """As `RestoreJob.restore`. Raises MissingCredential, DamagedData."""
        run, place = self.run, self.folder.path / WORK
        if run.again and not (place / _AGAIN).exists():
            shutil.rmtree(place, ignore_errors=True)
        wanted = self.left()
        stopped: Stopped | None = None
        summary = Summary(command="restore", source="youtube", requests=0, units=0, failed=0)
        if wanted:
            write_text(place / "ids.txt", "".join(f"{key}\n" for key in wanted))
            if run.again:
                write_text(place / _AGAIN, "")
            source = YouTubeConnector(run, _available, ids=place / "ids.txt")
            try:
                summary |= work(
                    run,
                    source,
                    source.summary,
                    place=place,
                    phases=source.chosen,
                    removed=self.removed,
                )
            except GLOBAL_STOPS:
                raise
            except Stopped as error:
                summary |= error.summary or {}
                stopped = error
            self.removed.update(source.theirs)
        answered = bool(wanted) and summary.get("crawled_in_all", 0)
        if answered:
            self.clean(replace(run, root=place, limit=None, again=False))
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

    def _restored(self) -> dict[str, str]:
        """Each restored video and the kind of its transcript. Raises DamagedData."""
        kinds: dict[str, str] = {}
        for path in parquet_files(self.folder.path / "videos"):
            with reading([path]):
                kinds |= _kinds(path)
        return kinds

    def _has_removed(self) -> bool:
        """Whether removed videos are in the tables, or wanted ones are not listed yet."""
        listed = {name for name, one in self.folder.missing().items() if one.reason == PURGED}
        unlisted = (key for key in self.kinds if f"{VIDEO}{key}" not in listed)
        return not self.removed.isdisjoint([*self._restored(), *unlisted])

    def _merge(self, place: Path) -> None:
        """Clean tables of the work folder → the restored ones, and the reasons of the rest."""
        clean, scratch = Layout(place), place / "rows"
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        fresh = {one: parquet_files(clean.clean(*one.name.split("/"))) for one in TABLES}
        videos: dict[str, str] = {}
        for path in fresh[TABLES[1]]:
            videos |= _kinds(path)
        # A transcript that could not be read this time keeps the restored one.
        reasons = {
            f"{TRANSCRIPT}{key}": MissingReason(NONE if kind == NONE else FAILED)
            for key, kind in videos.items()
            if kind in (NONE, UNKNOWN)
        }
        unlisted = {
            f"{TRANSCRIPT}{key}" for key in videos if self.kinds.get(key, NONE) == videos[key]
        }
        lost = {key: MissingReason(PURGED, FOREVER) for key in self.removed}
        for verdict in ("failed", "rejected"):
            for path in parquet_files(clean.clean("youtube", verdict)):
                for row in parquet.read_table(path, columns=["key", "reason"]).to_pylist():
                    why = FAILED if verdict == "failed" else row["reason"]
                    lost.setdefault(row["key"], MissingReason(why))
        for key, why in lost.items():
            reasons |= {f"{VIDEO}{key}": why, f"{TRANSCRIPT}{key}": why}
            unlisted.add(f"{TRANSCRIPT}{key}")
        unlisted |= {f"{VIDEO}{key}" for key in self.removed if key not in self.kinds}
        folder = self.folder
        buckets = folder.buckets(len(videos))
        for one, paths in fresh.items():
            with Shuffle(scratch, f"new-{one.declared.short}", buckets) as shuffle:
                for path in paths:
                    rows = parquet.read_table(path)
                    shuffle.write(rows, rows["video_id"])
        folder.merge(scratch, buckets, reasons, unlisted=unlisted)


def _available(videos: Any) -> list[str]:
    """Every video that is there and public is worth its transcript: it was kept once."""
    hidden = pc.is_in(videos["availability"], value_set=pa.array(NOT_PUBLIC))
    gone = pc.fill_null(videos["missing"], False)
    rows = videos.filter(pc.invert(pc.or_(gone, hidden)))
    return cast("list[str]", rows["video_id"].to_pylist())


def _kinds(path: Path) -> dict[str, str]:
    """Videos of a table and the kinds of their transcripts."""
    rows = parquet.read_table(path, columns=[*_COLUMNS])
    ids, kinds = (cast("list[str]", rows[name].to_pylist()) for name in _COLUMNS)
    return dict(zip(ids, kinds, strict=True))
