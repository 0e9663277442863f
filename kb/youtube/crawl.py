"""The crawl: two lanes over one frontier, so that the API's quota and the web site's patience are used side by side.

    API lane (this thread)    searches → uploads → videos, 50 ids a call packed across channels
    web lane (threads)        transcripts of the videos that pass the cheap filters

A lane that must stop (quota spent, blocked) lets the other one go on; then the run ends with exit 3.
With a limit only as much is listed and searched as the videos need.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from kb.core.context import Run
from kb.core.errors import (
    Blocked,
    FatalError,
    KbError,
    LimitReached,
    QuotaSpent,
    SettingError,
    Stopped,
)
from kb.core.verdict import Summary
from kb.net.rate import Pace, is_loopback
from kb.store import belonging, identity, lock, tombstones
from kb.store.frontier import Frontier
from kb.store.recorder import Recorder
from kb.youtube import effects, errors
from kb.youtube.api import GOOGLE
from kb.youtube.api_lane import ApiLane
from kb.youtube.effects import CHANNELS, SEARCHES, TRANSCRIPTS, UPLOADS, VIDEOS, Effects, Wanted
from kb.youtube.ids import share, some_ids
from kb.youtube.job import Job
from kb.youtube.transcripts import SITE
from kb.youtube.web_lane import WebLane

_log = logging.getLogger("kb.youtube")

PHASES = {
    "channels": (SEARCHES,),
    "uploads": (UPLOADS,),
    "metadata": (VIDEOS,),
    "transcripts": (TRANSCRIPTS,),
}


def crawl(
    run: Run,
    wanted: Wanted,
    *,
    only: str | None = None,
    ids: Path | None = None,
    part: tuple[int, int] | None = None,
) -> Summary:
    """Crawl until nothing is left. `wanted` picks the videos whose transcript is worth asking for.

    Raises Stopped (with `summary`) when something is left for another run, and what kb.core.errors says for the rest.
    """
    profile = run.profile.section("youtube")
    if only != "transcripts":
        run.settings.need("youtube_api_key")
    run.settings.check_contact()
    if ids and only in ("channels", "uploads"):
        raise SettingError(
            f"--ids skips discovery, so there is nothing to do for --only {only}",
            hint="leave one of the two away",
        )
    known, bad_lines = some_ids(ids) if ids else ([], 0)
    mine = share(part)
    with ExitStack() as stack:
        stack.enter_context(lock.writer(run.root, "youtube"))
        api, web = run.settings.kb_youtube_endpoint or GOOGLE, run.settings.kb_youtube_web or SITE
        belonging.note(run.root, run.profile)
        identity.remember(run.root, "youtube", api=api, web=web)
        frontier = Frontier(run.root / "state" / "youtube.sqlite")
        stack.callback(frontier.close)
        purged = tombstones.keys(run.root, "youtube")
        follow = Effects(profile, wanted, mine, purged)
        recorder = stack.enter_context(
            Recorder(run.root, "youtube", frontier, follow, asked=effects.ASKED)
        )
        job = Job(run, frontier, recorder, _phases(only, ids))
        job.summary["bad_lines"] = bad_lines
        if ids:
            frontier.add(VIDEOS, [key for key in known if mine(key) and key not in purged])
        _begin(job, mine, discover=ids is None)
        return _finish(job, _run_lanes(job))


def _phases(only: str | None, ids: Path | None) -> set[str]:
    if only:
        return set(PHASES[only])
    return {VIDEOS, TRANSCRIPTS} if ids else {SEARCHES, UPLOADS, VIDEOS, TRANSCRIPTS}


def _begin(job: Job, mine: Callable[[str], bool], *, discover: bool) -> None:
    """Extend the frontier; what failed before gets another chance; a new round starts over.

    New are the profile's keywords, and channels that were another part's share. Known ids alone (`discover` False)
    leave searches and lists as they are.
    """
    frontier = job.frontier
    _reopen(job)
    if not discover:
        return
    words = job.profile.keywords
    frontier.add(
        SEARCHES,
        [(effects.search_key(word, None), {"q": word, "token": None, "page": 1}) for word in words],
    )
    channels = (key for key, *_ in frontier.items(CHANNELS) if mine(key))
    frontier.add(
        UPLOADS,
        [
            (key, {"playlist": effects.uploads_list(key, job.profile), "token": None})
            for key in channels
        ],
    )
    if job.run.again and not any(frontier.ready(kind) for kind in (SEARCHES, UPLOADS, VIDEOS)):
        with frontier.transaction():
            frontier.set_cursor("round", frontier.cursor("round", 1) + 1)
            searches = [key for key, *_ in frontier.items(SEARCHES)]
            frontier.remove(SEARCHES, [key for key in searches if not key.endswith("#")])
            frontier.mark(SEARCHES, [key for key in searches if key.endswith("#")], "todo")
            frontier.reopen(UPLOADS, "done", "skipped")


def _reopen(job: Job) -> None:
    """What failed, and what was taken as final without being a fact: by an earlier version, or under fewer search_pages."""
    frontier = job.frontier
    for kind in (SEARCHES, UPLOADS, VIDEOS, TRANSCRIPTS):
        frontier.reopen(kind, "error")
    most = job.profile.search_pages
    pages = [
        key
        for key, _, reason, item in frontier.items(SEARCHES, "skipped")
        if reason != effects.BEYOND or item["page"] <= most
    ]
    frontier.mark(SEARCHES, pages, "todo")
    frontier.mark(
        UPLOADS,
        [
            key
            for key, _, reason, _ in frontier.items(UPLOADS, "skipped")
            if reason not in errors.FINAL
        ],
        "todo",
    )
    frontier.reopen(VIDEOS, "skipped")


def _run_lanes(job: Job) -> list[KbError]:
    """Both lanes until they end; the reasons to stop, none when there is nothing left."""
    web = WebLane(job, _pace(job))
    api = ApiLane(job, wake=web.wake)
    stops: list[KbError] = []
    threads = []
    if TRANSCRIPTS in job.phases:
        workers = max(1, min(job.run.workers, 4))
        threads = [
            threading.Thread(target=web.work, name=f"transcripts-{number}")
            for number in range(workers)
        ]
    for thread in threads:
        thread.start()
    try:
        api.work()
    except KbError as stop:
        stops.append(stop)
        if not isinstance(stop, (QuotaSpent, LimitReached, Blocked)):
            web.end(stop)
    except BaseException as error:
        web.end(Stopped(str(error)))
        raise
    finally:
        web.no_more()
        for thread in threads:
            thread.join()
        job.close(stopped=bool(stops) or web.stop is not None)
    return stops + ([web.stop] if web.stop is not None else [])


def _nowhere(job: Job) -> FatalError | None:
    """Name keywords that find no channel; the error where none finds any: nothing can follow."""
    if SEARCHES not in job.phases:
        return None
    words = job.profile.keywords
    barren = effects.without_channels(job.frontier, words)
    path = job.run.profile.path
    if len(barren) == len(set(words)) and not job.frontier.counts(CHANNELS):
        return FatalError(
            f"no keyword of the profile {job.run.profile.name!r} finds a channel:"
            f" {', '.join(map(repr, barren))}",
            hint=f"change `keywords` under [youtube] in {path}{_line(path)}",
        )
    for word in barren:
        _log.warning(
            "the keyword %r of the profile finds no channel (%s%s)", word, path, _line(path)
        )
    return None


def _line(path: Path) -> str:
    """Where the keywords stand in a profile, as ", line 8"."""
    section = ""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if text.startswith("["):
            section = text
        elif section == "[youtube]" and text.split("=")[0].strip() == "keywords":
            return f", line {number}"
    return ""


def _pace(job: Job) -> Pace:
    loopback = is_loopback(job.run.settings.kb_youtube_web or SITE)
    return Pace(0 if loopback else 3600 / job.profile.transcripts_per_hour)


def _finish(job: Job, stops: list[KbError]) -> Summary:
    summary = job.count()
    # A limit that took everything there was is no stop.
    stops = [
        stop for stop in stops if not (isinstance(stop, LimitReached) and summary["left"] == 0)
    ]
    nowhere = _nowhere(job)
    if nowhere is not None:
        stops = [nowhere]
    if stops:
        worst = min(stops, key=lambda stop: stop.exit_code if stop.exit_code != 3 else 9)
        worst.summary = summary
        raise worst
    if not summary["requests"]:
        job.run.progress.say(
            "youtube: nothing left to crawl"
            + ("" if job.run.again else "; --again starts a new round")
        )
    return summary
