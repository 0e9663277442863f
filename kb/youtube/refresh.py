"""Read again what is older than the profile allows: API data that is not refreshed should go (YouTube's terms).

Newer answers win when filtering; a video that is no longer returned becomes `missing`, and `kb purge youtube`
removes it.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock, signals, vocabulary
from kb.core.context import Run
from kb.core.errors import ItemFinal, LimitReached, QuotaSpent, Retryable
from kb.core.plan import Phase, plan
from kb.core.verdict import Summary
from kb.store import identity, lock, rawlog, tombstones
from kb.store.frontier import ROUND, Frontier, going_on
from kb.store.recorder import Recorder
from kb.youtube import effects, parse
from kb.youtube.api import GOOGLE, Api
from kb.youtube.api_lane import FRAME, PARTS
from kb.youtube.effects import REFRESH, Effects
from kb.youtube.job import PACK
from kb.youtube.quota import GENERAL, limit, today
from kb.youtube.transcripts import SITE

BYTES_A_CALL = 60_000  # compressed, of 50 videos


class _Head(msgspec.Struct):
    """Of an envelope, when and what was asked; the answer itself is not decoded."""

    fetched_at: str
    request: rawlog.Request


def newest(root: Path) -> dict[str, str]:
    """When each video was last asked for, by id."""
    decoder = msgspec.json.Decoder(_Head)
    found: dict[str, str] = {}
    for path in rawlog.segments(root, "youtube", effects.RAW_VIDEOS):
        for _, line in rawlog.Frames(path):
            head = decoder.decode(line)
            for key in parse.requested(head.request.params):
                if found.get(key, "") < head.fetched_at:
                    found[key] = head.fetched_at
    return found


def plan_refresh(run: Run, older_than: int | None = None) -> Summary:
    """What a refresh would read again now, and its units. Sends and writes nothing."""
    purged = tombstones.keys(run.root, "youtube")
    old = len(_old(run, run.profile.section("youtube"), purged, older_than))
    calls = math.ceil(old / PACK)
    gb = calls * BYTES_A_CALL / 1e9
    phase = Phase("videos to refresh", old, requests=calls, units=calls, gb=gb)
    assumed = [f"{BYTES_A_CALL // 1000} kB a call of {PACK} videos"]
    return Summary(plan("refresh youtube", "youtube", [phase], assumed))


def _old(run: Run, profile: Any, purged: set[str], older_than: int | None) -> list[str]:
    """Ids of videos whose newest answer is older than `older_than` days, or than the profile allows."""
    days = profile.max_age_days if older_than is None else older_than
    oldest = clock.now() - timedelta(days=days)
    return [
        key
        for key, at in newest(run.root).items()
        # With 0 days also what was read in this very second.
        if (clock.parse(at) < oldest or older_than == 0) and key not in purged
    ]


def refresh(run: Run, older_than: int | None = None) -> Summary:
    """Read the metadata of every video again whose newest answer is older than `max_age_days`.

    `older_than` days count instead (0: everything). What it found due is kept until it is read, so the same
    command goes on where it stopped. One unit for 50 videos. Raises Stopped with `summary` when something is left.
    """
    profile = run.profile.section("youtube")
    run.settings.need("youtube_api_key")
    run.settings.check_contact()
    days = profile.max_age_days if older_than is None else older_than
    with ExitStack() as stack:
        stack.enter_context(lock.writer(run.root, "youtube"))
        identity.remember(
            run.root,
            "youtube",
            api=run.settings.kb_youtube_endpoint or GOOGLE,
            web=run.settings.kb_youtube_web or SITE,
        )
        frontier = Frontier(run.root / "state" / "youtube.sqlite")
        stack.callback(frontier.close)
        purged = tombstones.keys(run.root, "youtube")
        # Transcripts don't age; nothing new is asked of the web site here.
        recorder = stack.enter_context(
            Recorder(
                run.root,
                "youtube",
                frontier,
                Effects(profile, lambda rows: (), lambda key: True, purged),
                asked=effects.ASKED,
            )
        )
        if not going_on(frontier, REFRESH, older_than):
            old = _old(run, profile, purged, older_than)
            with frontier.transaction():
                frontier.replace(REFRESH, old)
                frontier.set_cursor(ROUND, older_than)
        left = frontier.counts(REFRESH).get("todo", 0)
        return _read(run, profile, frontier, recorder, left, days)


def _read(
    run: Run, profile: Any, frontier: Frontier, recorder: Recorder, total: int, days: int
) -> Summary:
    before = frontier.requests()
    summary = Summary(
        command="refresh youtube",
        source="youtube",
        counted="videos",
        crawled=0,
        missing=0,
        failed=0,
        requests=0,
        units=0,
        left=total,
        left_by={},
    )
    if not total:
        run.progress.say(f"youtube: nothing is older than {days} days")
        return summary
    api, task = (
        Api(run.settings, profile, frontier, wait=run.wait),
        run.progress.task("refresh", total, "videos"),
    )
    try:
        while frontier.ready(REFRESH):
            signals.stop.check()
            room = PACK if run.limit is None else min(PACK, run.limit - summary["crawled"])
            if room <= 0:
                raise LimitReached(
                    f"--limit {run.limit} reached", hint="run the same command to go on"
                )
            keys = [item.key for item in frontier.take(REFRESH, room)]
            params = {"id": ",".join(keys), "part": PARTS, **FRAME}
            try:
                answer = api.videos(**params)
            except (Retryable, ItemFinal) as error:
                frontier.mark(REFRESH, keys, "error", error.reason)
                continue
            except QuotaSpent as stop:
                frontier.release(REFRESH, *keys)
                if not run.wait or stop.reset_at is None:
                    raise
                run.progress.say(
                    f"youtube: quota spent; waiting until {clock.stamp(stop.reset_at)}"
                )
                clock.sleep_until(stop.reset_at)
                continue
            except BaseException:
                frontier.release(REFRESH, *keys)
                raise
            recorder.record(effects.RAW_VIDEOS, "videos.list", params, 200, answer)
            summary["crawled"] += len(keys)
            summary["missing"] += len(parse.missing(params, answer))
            task.advance(
                len(keys), quota=f"{frontier.spent(GENERAL, today()):,}/{limit(profile, GENERAL):,}"
            )
    except Exception as error:
        error.summary = _final(summary, frontier, before)  # type: ignore[attr-defined]
        raise
    finally:
        api.close()
        task.close(stopped=summary["crawled"] < total)
    return _final(summary, frontier, before)


def _final(summary: Summary, frontier: Frontier, before: tuple[int, int]) -> Summary:
    requests, units = frontier.requests()
    counts = frontier.counts(REFRESH)
    left = vocabulary.left_by("youtube", {REFRESH: counts})
    summary |= {
        "requests": requests - before[0],
        "units": units - before[1],
        "failed": counts.get("error", 0),
        "left": sum(left.values()),
        "left_by": left,
    }
    return summary
