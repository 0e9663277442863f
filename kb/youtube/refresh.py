"""Read again what is older than the profile allows: API data that is not refreshed should go (YouTube's terms).

Newer answers win when filtering; a video that is no longer returned becomes `missing`, and `kb purge youtube`
removes it.
"""

from __future__ import annotations

from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock, signals
from kb.core.context import Run
from kb.core.errors import ItemFinal, LimitReached, QuotaSpent, Retryable
from kb.core.verdict import Summary
from kb.store import identity, lock, rawlog, tombstones
from kb.store.frontier import Frontier
from kb.store.recorder import Recorder
from kb.youtube import effects, parse
from kb.youtube.api import GOOGLE, Api
from kb.youtube.api_lane import FRAME, PARTS
from kb.youtube.effects import REFRESH, Effects
from kb.youtube.job import PACK
from kb.youtube.quota import GENERAL, limit, today
from kb.youtube.transcripts import SITE


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


def refresh(run: Run) -> Summary:
    """Read the metadata of every video again whose newest answer is older than `max_age_days`.

    One unit for 50 videos. Raises Stopped with `summary` when something is left.
    """
    profile = run.profile.section("youtube")
    run.settings.need("youtube_api_key")
    oldest = clock.now() - timedelta(days=profile.max_age_days)
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
        old = [
            key
            for key, at in newest(run.root).items()
            if clock.parse(at) < oldest and key not in purged
        ]
        frontier.remove(REFRESH, [key for key, *_ in frontier.items(REFRESH)])
        frontier.add(REFRESH, old)
        return _read(run, profile, frontier, recorder, len(old))


def _read(run: Run, profile: Any, frontier: Frontier, recorder: Recorder, total: int) -> Summary:
    before = frontier.requests()
    summary = Summary(crawled=0, missing=0, failed=0, requests=0, units=0, left=total)
    if not total:
        run.progress.say(f"youtube: nothing is older than {profile.max_age_days} days")
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
        task.close()
    return _final(summary, frontier, before)


def _final(summary: Summary, frontier: Frontier, before: tuple[int, int]) -> Summary:
    requests, units = frontier.requests()
    counts = frontier.counts(REFRESH)
    summary |= {
        "requests": requests - before[0],
        "units": units - before[1],
        "failed": counts.get("error", 0),
        "left": counts.get("todo", 0),
    }
    return summary
