"""Videos and transcripts of released folders, as a job of `kb restore`."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.restore import FAILED, FOREVER, PURGED, MissingReason, RestoredTable
from kb.core.cached_property import cached_property
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart
from kb.crawl.job import work
from kb.crawl.restore import ItemRestore, Outcome
from kb.schema.video_facts import NOT_PUBLIC
from kb.store.atomic import write_text
from kb.store.layout import Layout, parquet_files
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.store.tables.reading import reading
from kb.youtube.crawl.connector import YouTubeConnector
from kb.youtube.plan import REQUESTS_A_TRANSCRIPT, phases_of_known

VIDEO, TRANSCRIPT = "video ", "transcript "  # prefixes of names in missing.parquet
TABLES = (
    RestoredTable("youtube/transcripts", TRANSCRIPT),
    RestoredTable("youtube/videos", VIDEO),
)
NONE, UNKNOWN = "none", "unknown"  # kinds of a transcript: the video has none, or reading it failed
_COLUMNS = ("video_id", "transcript_kind")


@dataclass(frozen=True)
class VideoRestore(ItemRestore):
    """Restores videos of released tables and pairs."""

    @property
    def tables(self) -> tuple[RestoredTable, ...]:
        return TABLES

    @cached_property
    def keys(self) -> dict[str, str]:
        """Each wanted video, and the kind of transcript it was released with."""
        folders, tables = self.content.chosen, ("videos", "pairs")
        kinds = _kinds(path for one in folders for short in tables for path in one.shards(short))
        for path in (
            path for one in self.content.folders_of("draw") for path in one.shards("draw")
        ):
            with reading([path]):
                ids = parquet.read_table(path, columns=["video_id"])["video_id"].to_pylist()
            for key in cast("list[str]", ids):
                kinds.setdefault(key, "asr")  # a pair has a transcript, of one kind or the other
        return kinds

    @cached_property
    def removed(self) -> set[str]:
        """Videos that the releases, of pairs too, or this data root list as removed."""
        own = tombstones.keys(self.run.root, "youtube")
        return self.content.removed("youtube", "pairs", "draw") | own

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`."""
        if not (left := self.left()):
            return PlanPart()
        videos, transcripts = phases_of_known(self.run, len(left))
        key = self.run.settings.named("youtube_api_key")
        phases = [
            videos.asking(f"YouTube's Data API, {key}"),
            transcripts.asking("youtube.com, no key"),
        ]
        return PlanPart(phases, [f"{REQUESTS_A_TRANSCRIPT} requests a transcript"])

    def crawl(self, left: list[str], place: Path) -> Summary:
        """As of any source."""
        write_text(place / "ids.txt", "".join(f"{key}\n" for key in left))
        asking = YouTubeConnector(self.run, _available, ids=place / "ids.txt")
        try:
            return work(
                self.run,
                asking,
                asking.summary,
                place=place,
                phases=asking.chosen,
                removed=self.removed,
            )
        finally:
            self.removed.update(asking.theirs)

    def restored(self) -> list[str]:
        """Restored videos but for those whose transcript could not be read. Raises DamagedData."""
        kinds = _kinds(parquet_files(self.folder.path / "videos"))
        return [key for key, kind in kinds.items() if kind != UNKNOWN]

    def outcome(self, place: Path) -> Outcome:
        """Of videos and their transcripts, which have verdicts."""
        clean = Layout(place)
        videos = _kinds(parquet_files(clean.clean("youtube", "videos")))
        # A transcript that could not be read this time keeps the restored one.
        reasons = {
            f"{TRANSCRIPT}{key}": MissingReason(NONE if kind == NONE else FAILED)
            for key, kind in videos.items()
            if kind in (NONE, UNKNOWN)
        }
        unlisted = {
            f"{TRANSCRIPT}{key}" for key in videos if self.keys.get(key, NONE) == videos[key]
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
        unlisted |= {f"{VIDEO}{key}" for key in self.removed if key not in self.keys}
        return Outcome(reasons, unlisted)


def _available(videos: Any) -> list[str]:
    """Every video that is there and public is worth its transcript: it was kept once."""
    hidden = pc.is_in(videos["availability"], value_set=pa.array(NOT_PUBLIC))
    gone = pc.fill_null(videos["missing"], False)
    rows = videos.filter(pc.invert(pc.or_(gone, hidden)))
    return cast("list[str]", rows["video_id"].to_pylist())


def _kinds(paths: Iterable[Path]) -> dict[str, str]:
    """Videos of tables and the kinds of their transcripts. Raises DamagedData."""
    kinds: dict[str, str] = {}
    for path in paths:
        with reading([path]):
            rows = parquet.read_table(path, columns=[*_COLUMNS])
        ids, of_ids = (cast("list[str]", rows[name].to_pylist()) for name in _COLUMNS)
        kinds |= zip(ids, of_ids, strict=True)
    return kinds
