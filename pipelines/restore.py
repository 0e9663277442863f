"""Restore (MineDojo paper, datasheet: distribution): a release has ids and structure; whoever
downloads it brings the content back with keys of their own.

    videos, transcripts    by id, as a crawl of known ids; no stage judges them again
    posts, comments        by full name with a key, or out of archive dumps
    texts of the pairs     cut out of the restored transcripts
    missing                what could not be had, and why; what was removed is never asked for
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.core import plan as planned
from kb.core.addresses import is_loopback
from kb.core.context import Run
from kb.core.errors import Interrupted, SettingError, Stopped
from kb.core.pipeline import load, locate
from kb.core.profile import Profile
from kb.core.settings import Settings
from kb.core.verdict import Summary
from kb.filters.chain import Chain, Clean
from kb.filters.clean import run_clean
from kb.filters.judgement import Judgement, Predicate, nothing
from kb.filters.predicates import NotTrue, Present
from kb.filters.topic import Topic
from kb.pairs import refill
from kb.reddit import reconstruction
from kb.reddit.importing import check_readable
from kb.reddit.plan import plan_rebuild
from kb.release.downloaded import Downloaded, verify
from kb.schema import table
from kb.store import parquet
from kb.store.layout import Layout, parquet_files
from kb.store.reading import reading
from kb.store.shards import write_table
from kb.youtube import plan as videos_plan
from kb.youtube import restored
from kb.youtube.fetch import PACK


class Wanted(NamedTuple):
    """What is to come back: ids of videos, and folders of the rest."""

    videos: list[str]
    had: dict[str, str]  # the kind of transcript that a released video had
    reddit: list[Path]
    pairs: list[Path]
    removed: dict[str, set[str]]  # tombstones of the releases, by source


class Evidence(Topic):
    """What shows the topic now. Nothing is rejected: it was judged when it was released."""

    def fill(self, rows: pa.Table) -> pa.Table:
        """As in a filter; "none" where nothing shows it any more."""
        rows = super().fill(rows)
        place = rows.column_names.index("topic_evidence")
        shown = pc.fill_null(rows["topic_evidence"], "none")
        return rows.set_column(place, "topic_evidence", shown)

    def judge(self, rows: pa.Table) -> Judgement:
        """All pass."""
        return Judgement(nothing(rows), nothing(rows), None)


def clean(p: Profile) -> Clean:
    """Raw answers to the tables of every video that is there: what is released was judged."""
    section = p.section("youtube")
    needed = ("view_count", "duration_s", "width", "height")
    stages: tuple[Predicate, ...] = (
        NotTrue("missing", stage="missing", reason="missing"),
        *(Present(column, stage="missing") for column in needed),
        Evidence(section.game_ids, section.category_ids, section.words),
    )
    helpers = ("missing", "game_label_id", "game_label", "transcript_outcome")
    chain = Chain("youtube/videos", "video_id", stages, helpers=helpers)
    whole: Clean = load(str(locate("youtube"))).clean(p)
    return replace(whole, chains=(chain,), scorer=None)


def restore(
    run: Run, found: Sequence[Downloaded], dumps: Sequence[Path] = (), only: str | None = None
) -> Summary:
    """Bring everything back into `restored/` of the data root.

    Raises SettingError and MissingCredential before anything is sent, DamagedData where a folder
    is not whole; Stopped, with what was done, when something is left: the same command goes on.
    """
    wanted = _wanted(found, only)
    _check(run, wanted, dumps)
    verify(run, found)
    if not (wanted.videos or wanted.reddit or wanted.pairs):
        run.progress.say("these folders hold everything: there is nothing to bring back")
        return Summary(command="restore", requests=0, units=0, failed=0)
    summary = Summary(command="restore", requests=0, units=0, failed=0)
    stopped: list[Stopped] = []
    if wanted.videos:
        removed = wanted.removed["youtube"]
        bring = partial(restored.bring, run, wanted.videos, _sort, gone=removed, had=wanted.had)
        _take(summary, bring, stopped)
    if wanted.reddit:
        out, removed = Layout(run.root).restored("reddit"), wanted.removed["reddit"]
        ids: list[str | Path] = [*wanted.reddit]
        rebuild = partial(reconstruction.rebuild, run, ids, out, dumps=dumps, gone=removed)
        _take(summary, rebuild, stopped)
    for folder in wanted.pairs:
        filled = refill.restore(run, folder, wanted.removed["youtube"])
        summary |= {name: filled[name] for name in ("pairs", "filled", "differing")}
    summary["missing"] = _missing(run.root)
    summary["path"] = str(Layout(run.root).restored())
    if stopped:
        stopped[0].summary = summary
        raise stopped[0]
    return summary


def plan(
    run: Run, found: Sequence[Downloaded], dumps: Sequence[Path] = (), only: str | None = None
) -> Summary:
    """What would be asked, of whom, with which key. Sends and writes nothing."""
    wanted = _wanted(found, only)
    phases: list[planned.Phase] = []
    assumed: list[str] = []
    if wanted.videos:
        left = restored.left(run, wanted.videos, wanted.removed["youtube"])
        calls, asked = math.ceil(len(left) / PACK), len(left) * videos_plan.REQUESTS_A_TRANSCRIPT
        pace = run.profile.section("youtube").transcripts_per_hour
        local = is_loopback(run.settings.kb_youtube_web or "")
        hours = 0.0 if local else len(left) / pace
        sizes = videos_plan.BYTES
        phases += [
            planned.Phase(
                f"videos of YouTube's Data API, {_key(run.settings, 'youtube_api_key')}",
                len(left),
                calls,
                calls,
                gb=calls * sizes["videos"] / 1e9,
            ),
            planned.Phase(
                "transcripts of youtube.com, no key",
                len(left),
                asked,
                0,
                hours,
                len(left) * sizes["transcripts"] / 1e9,
            ),
        ]
        assumed.append(f"{videos_plan.REQUESTS_A_TRANSCRIPT} requests a transcript")
    if wanted.reddit:
        of = "dumps, no key" if dumps else f"Reddit, {_key(run.settings, 'reddit_client_id')}"
        summary = plan_rebuild(run, [*wanted.reddit], dumps)
        phases += [
            planned.Phase(**{**one, "phase": f"{one['phase']} of {of}"})
            for one in summary["phases"]
        ]
        assumed.append(str(summary["assumed"]))
    if wanted.pairs:
        texts = sum(_rows(Downloaded(one, "pairs").shards("pairs")) for one in wanted.pairs)
        phases.append(planned.Phase("texts of pairs, out of the transcripts", texts))
    return Summary(planned.plan("restore", "", phases, assumed))


def _wanted(found: Sequence[Downloaded], only: str | None) -> Wanted:
    """What these folders need, and `only` asks for. Raises SettingError."""
    mine = [one for one in found if only is None or one.source == only]
    if only and not mine:
        raise SettingError(
            f"--only {only}: none of the folders is of {only}",
            hint=f"they are of {', '.join(sorted({one.source for one in found}))}",
        )
    removed: dict[str, set[str]] = {"youtube": set(), "reddit": set()}
    for one in found:
        of = "youtube" if one.source == "pairs" else one.source
        if of in removed:
            removed[of] |= one.removed()
    videos: list[str] = []
    had: dict[str, str] = {}
    for one in mine:
        for path in (*one.shards("videos"), *one.shards("pairs")):
            with reading([path]):
                rows = parquet.read_table(path, columns=["video_id", "transcript_kind"])
            keys = cast("list[str]", rows["video_id"].to_pylist())
            videos += keys
            had |= zip(keys, cast("list[str]", rows["transcript_kind"].to_pylist()), strict=True)
    return Wanted(
        list(dict.fromkeys(videos)),
        had,
        [one.path for one in mine if one.source == "reddit"],
        [one.path for one in mine if one.source == "pairs"],
        removed,
    )


def _check(run: Run, wanted: Wanted, dumps: Sequence[Path]) -> None:
    """What is needed, before anything is sent. Raises MissingCredential, SettingError."""
    if dumps:
        check_readable(dumps)
    if wanted.videos:
        run.profile.section("youtube")
        if restored.left(run, wanted.videos, wanted.removed["youtube"]):
            run.settings.need("youtube_api_key")
    if wanted.reddit:
        run.profile.section("reddit")
        if not dumps:
            reconstruction.need_key(run)
    if wanted.pairs:
        run.profile.section("pairs")
        if len(wanted.pairs) > 1:
            raise SettingError(
                "several folders of pairs", hint="restore one index at a time, each into its --data"
            )


def _sort(run: Run) -> None:
    """The raw answers of a work folder → its clean tables, by `clean` above."""
    run_clean(replace(run, pipeline=str(locate("restore"))), "youtube")


def _take(summary: Summary, bring: Any, stopped: list[Stopped]) -> None:
    """Run one source's part. What stops it is noted, and the others go on."""
    try:
        done = bring()
    except Interrupted:
        raise
    except Stopped as error:
        done = error.summary or {}
        stopped.append(error)
    for name in ("requests", "units", "failed"):
        summary[name] += done.get(name, 0)
    for name in ("left", "bad_lines", "truncated_files"):
        if done.get(name):
            summary[name] = summary.get(name, 0) + done[name]
    for name in ("videos", "transcripts", "posts", "comments"):
        if name in done:
            summary[name] = done[name]


def _missing(root: Path) -> int:
    """Everything that could not be had → restored/missing.parquet; how much it is."""
    at = Layout(root)
    parts = [_reasons(at.restored("youtube") / "missing.parquet")]
    reddit = at.restored("reddit") / "missing.parquet"
    if reddit.is_file():
        rows = parquet.read_table(reddit, columns=["key", "reason"])
        keys, reasons = (rows[name].cast(pa.string()) for name in ("key", "reason"))
        kinds = pc.if_else(pc.starts_with(keys, "t3_"), "post", "comment")
        parts.append(_rows_of("reddit", kinds, keys, reasons))
    transcripts = parquet_files(at.restored("youtube", "transcripts"))
    ids = [
        parquet.read_table(path, columns=["video_id"])["video_id"].cast(pa.string())
        for path in transcripts
    ]
    there = pa.chunked_array([chunk for one in ids for chunk in one.chunks], pa.string())
    for path in parquet_files(at.restored("pairs")):
        rows = parquet.read_table(path, columns=["pair_id", "video_id", "text"])
        rows = rows.filter(pc.is_null(rows["text"]))
        has = pc.is_in(rows["video_id"].cast(pa.string()), value_set=there.combine_chunks())
        reasons = pc.if_else(has, "other transcript", "no transcript")
        kinds = pa.array(["text"] * rows.num_rows, pa.string())
        parts.append(_rows_of("pairs", kinds, rows["pair_id"].cast(pa.string()), reasons))
    whole = pa.concat_tables(parts)
    write_table(at.restored() / "missing.parquet", whole, "shared/missing")
    return whole.num_rows


def _rows_of(source: str, parts: Any, keys: Any, reasons: Any) -> pa.Table:
    of = pa.array([source] * len(keys), pa.string())
    return pa.table({"source": of, "part": parts, "key": keys, "reason": reasons})


def _reasons(path: Path) -> pa.Table:
    schema = pa.schema([(name, pa.string()) for name in table("shared/missing").names()])
    if not path.is_file():
        return schema.empty_table()
    return parquet.read_table(path, columns=schema.names).cast(schema)


def _rows(files: Sequence[Path]) -> int:
    with reading(files):
        return sum(pq.read_metadata(path).num_rows for path in files)


def _key(settings: Settings, name: str) -> str:
    """The setting of a key, and whether it is there."""
    there = getattr(settings, name) is not None
    return name.upper() if there else f"{name.upper()} (not set)"
