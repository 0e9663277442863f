"""Videos and transcripts that `kb restore` brings back by their ids.

    restored/youtube/videos, transcripts     the clean tables' columns, scores of models null
    restored/youtube/missing.parquet         what could not be had, with the reason
    restored/youtube/.work                   answers of a run that is not finished: a crawl's
                                             raw data and state, gone when nothing is left

Each run adds to the tables: of a video the newest answer counts, and what is no longer there, or
was purged, leaves them.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.core.context import Run
from kb.core.errors import Interrupted, Stopped
from kb.core.plan import PlanPart
from kb.core.profile.youtube import YouTubeSection
from kb.core.verdict import Summary
from kb.crawl.job import work
from kb.crawl.source import Opened
from kb.store import parquet, tombstones
from kb.store.atomic import replacing_folder, write_text
from kb.store.layout import Layout, parquet_files
from kb.store.reading import reading
from kb.store.shards import write_table
from kb.youtube.plan import REQUESTS_A_TRANSCRIPT, phases_of_known
from kb.youtube.source import YouTubeSource

# In the order of writing: a video whose row is there is not asked for again.
NAMES = ("transcripts", "videos")
VIDEO, TRANSCRIPT = "video", "transcript"  # what a row of missing.parquet is about
WORK, MISSING = ".work", "missing.parquet"
UNKNOWN = "unknown"  # kind of a transcript that was not had this time
_AGAIN = "again"  # in a work folder: everything is read anew


class RestoredIds(NamedTuple):
    """What a restored data root has: ids of whole videos, and of those that are gone."""

    there: set[str]
    gone: set[str]


def found(root: Path) -> RestoredIds:
    """What was asked for before and needs no asking. Raises DamagedData."""
    folder, there = Layout(root).restored("youtube"), set()
    for path in parquet_files(folder / "videos"):
        with reading([path]):
            rows = parquet.read_table(path, columns=["video_id", "transcript_kind"])
        known = rows.filter(pc.not_equal(rows["transcript_kind"].cast(pa.string()), UNKNOWN))
        there |= set(cast("list[str]", known["video_id"].to_pylist()))
    rows = _missing(folder)
    gone = rows.filter(
        pc.and_(pc.equal(rows["part"], VIDEO), pc.not_equal(rows["reason"], "failed"))
    )
    return RestoredIds(there, set(cast("list[str]", gone["key"].to_pylist())))


def plan(run: Run, ids: Collection[str], gone: Collection[str]) -> PlanPart:
    """What would be asked for, with which key. Sends and writes nothing."""
    if not ids:
        return PlanPart()
    videos, transcripts = phases_of_known(run, len(left(run, ids, gone)))
    key = run.settings.named("youtube_api_key")
    phases = [videos.of(f"YouTube's Data API, {key}"), transcripts.of("youtube.com, no key")]
    return PlanPart(phases, [f"{REQUESTS_A_TRANSCRIPT} requests a transcript"])


def left(run: Run, ids: Iterable[str], gone: Collection[str]) -> list[str]:
    """Those of the ids that have to be asked for, in their order."""
    known = RestoredIds(set(), set()) if run.again else found(run.root)
    removed = {*gone, *tombstones.keys(run.root, "youtube")}
    return [
        key
        for key in dict.fromkeys(ids)
        if key not in known.there and key not in known.gone and key not in removed
    ]


def needs(run: Run, ids: Collection[str], gone: Collection[str]) -> tuple[str, ...]:
    """The settings that it needs. Raises ProfileError where the profile has no [youtube]."""
    if ids:
        run.profile.section(YouTubeSection)
    return ("youtube_api_key",) if left(run, ids, gone) else ()


def bring(
    run: Run,
    ids: Iterable[str],
    sort: Callable[[Run], object],
    gone: Collection[str] = (),
    had: Mapping[str, str] | None = None,
) -> Summary:
    """Ask for what is left of the ids and add it to the tables, under the lock `restored`.

    `sort` makes clean tables of the raw answers of a work folder. `gone` were purged elsewhere.
    `had` says which of the videos had a transcript when they were released, by its kind. Raises
    MissingCredential before anything is sent; Stopped (with its summary; what was read until then
    is in the tables, and the same command goes on), DamagedData.
    """
    folder = Layout(run.root).restored("youtube")
    place = folder / WORK
    asked, removed = list(ids), {*gone, *tombstones.keys(run.root, "youtube")}
    if run.again and not (place / _AGAIN).exists():
        shutil.rmtree(place, ignore_errors=True)
    wanted = left(run, asked, gone)
    stopped: Stopped | None = None
    summary = Summary(command="restore", source="youtube", requests=0, units=0, failed=0)
    if wanted:
        write_text(place / "ids.txt", "".join(f"{key}\n" for key in wanted))
        if run.again:
            write_text(place / _AGAIN, "")
        source = Restore(run, place / "ids.txt", removed)
        try:
            summary |= work(run, source, source.summary, place=place, phases=source.chosen)
        except Interrupted:
            raise
        except Stopped as error:
            summary |= error.summary or {}
            stopped = error
    answered = bool(wanted) and summary.get("crawled_in_all", 0)
    if answered:
        inner = replace(run, root=place, limit=None, again=False)
        sort(inner)
    if answered or removed & found(run.root).there:
        _add(folder, place if answered else None, removed)
    _note(folder, place, asked, removed, had or {})
    if not stopped and not summary["failed"]:
        shutil.rmtree(place, ignore_errors=True)
    summary |= counts(run.root)
    if stopped is not None:
        stopped.summary = summary
        raise stopped
    return summary


class Restore(YouTubeSource):
    """The crawl of known ids, each with its transcript; `removed` ones are never asked for."""

    def __init__(self, run: Run, ids: Path, removed: Collection[str]) -> None:
        super().__init__(run, _there, ids=ids)
        self._removed = removed

    def begin(self, opened: Opened) -> None:
        """What was purged elsewhere counts as purged here."""
        opened.gone.update(self._removed)
        super().begin(opened)


def _there(videos: Any) -> list[str]:
    """Every video that is there is worth its transcript: it was kept once."""
    rows = videos.filter(pc.invert(pc.fill_null(videos["missing"], False)))
    return cast("list[str]", rows["video_id"].to_pylist())


def counts(root: Path) -> dict[str, int]:
    """Rows of the tables. Raises DamagedData."""
    folder = Layout(root).restored("youtube")
    sums = {}
    for name in NAMES:
        files = parquet_files(folder / name)
        with reading(files):
            sums[name] = sum(pq.read_metadata(path).num_rows for path in files)
    return sums


def _add(folder: Path, place: Path | None, removed: Collection[str]) -> None:
    """Rows of the work folder's clean tables → the restored ones; older rows of these go.

    Part files of both tables with one name are of the same videos.
    """
    fresh: dict[str, list[Path]] = {}
    rejected: list[Path] = []
    if place is not None:
        inner = Layout(place)
        fresh = {name: parquet_files(inner.clean("youtube", name)) for name in NAMES}
        rejected = parquet_files(inner.clean("youtube", "rejected"))
    drop = {name: {*removed} for name in NAMES}
    for path in fresh.get("videos", []):
        rows = parquet.read_table(path, columns=["video_id", "transcript_kind"])
        keys = cast("list[str]", rows["video_id"].to_pylist())
        drop["videos"].update(keys)
        kinds = rows["transcript_kind"].to_pylist()
        # One that only failed this time leaves the older transcript as it is.
        drop["transcripts"].update(
            key for key, kind in zip(keys, kinds, strict=True) if kind != UNKNOWN
        )
    for path in rejected:
        keys = cast("list[str]", parquet.read_table(path, columns=["key"])["key"].to_pylist())
        for name in NAMES:
            drop[name].update(keys)
    old = {name: parquet_files(folder / name) for name in NAMES}
    first = 1 + max(
        (int(path.stem.partition("-")[2]) for path in [*old["videos"], *old["transcripts"]]),
        default=-1,
    )
    for name in NAMES:
        gone = pa.array(sorted(drop[name]), pa.string())
        with replacing_folder(folder / name) as made, reading(old[name]):
            for path in old[name]:
                rows = parquet.read_table(path)
                kept = rows.filter(pc.invert(pc.is_in(rows["video_id"], value_set=gone)))
                if kept.num_rows:
                    write_table(made / path.name, kept, f"youtube/{name}")
            for path in fresh.get(name, []):
                rows = parquet.read_table(path)
                number = first + int(path.stem.partition("-")[2])
                if rows.num_rows or not number:  # a first part even where there is nothing
                    write_table(made / f"part-{number:05d}.parquet", rows, f"youtube/{name}")


def _note(
    folder: Path,
    place: Path,
    asked: list[str],
    removed: Collection[str],
    had: Mapping[str, str],
) -> None:
    """What of all that was ever asked for is not there → missing.parquet."""
    before = _missing(folder)
    why: dict[tuple[str, str], str] = {
        (part, key): reason
        for part, key, reason in zip(
            *(before[name].to_pylist() for name in ("part", "key", "reason")), strict=True
        )
    }
    for verdict in ("rejected", "failed"):
        for path in parquet_files(Layout(place).clean("youtube", verdict)):
            rows = parquet.read_table(path, columns=["key", "reason"])
            keys, reasons = (
                cast("list[str]", rows[name].to_pylist()) for name in rows.column_names
            )
            for key, reason in zip(keys, reasons, strict=True):
                why[VIDEO, key] = reason if verdict == "rejected" else "failed"
    why |= {(VIDEO, key): "purged" for key in asked if key in removed}
    kinds: dict[str, str] = {}
    for path in parquet_files(folder / "videos"):
        rows = parquet.read_table(path, columns=["video_id", "transcript_kind"])
        ids, of = (cast("list[str]", rows[name].to_pylist()) for name in rows.column_names)
        kinds |= zip(ids, of, strict=True)
    for key, kind in kinds.items():
        why.pop((VIDEO, key), None)
        if kind in ("none", UNKNOWN) and had.get(key, "none") != kind:
            why[TRANSCRIPT, key] = "failed" if kind == UNKNOWN else "none"
        elif kind not in ("none", UNKNOWN):
            why.pop((TRANSCRIPT, key), None)
    rows_ = [
        {"source": "youtube", "part": part, "key": key, "reason": reason}
        for (part, key), reason in sorted(why.items())
        if part == VIDEO or key in kinds
    ]
    schema = _missing(folder).schema
    write_table(folder / MISSING, pa.Table.from_pylist(rows_, schema), "shared/missing")


def _missing(folder: Path) -> pa.Table:
    """missing.parquet of the folder, with plain texts; without rows where there is none."""
    names = ("source", "part", "key", "reason")
    path = folder / MISSING
    schema = pa.schema([(name, pa.string()) for name in names])
    if not path.is_file():
        return schema.empty_table()
    with reading([path]):
        return parquet.read_table(path, columns=list(names)).cast(schema)
