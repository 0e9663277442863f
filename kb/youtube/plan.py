"""What is left of a crawl and what it costs, before anything is spent.

What is not known yet (how many channels a search finds, how many videos a channel has) is taken
from this data root as far as it was crawled, else from the assumptions below, and the plan says
which.
"""

import math
from pathlib import Path
from typing import Any

from kb.core.config.addresses import is_loopback
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary.plan import NOTHING_NEW, PlanPhase, to_read
from kb.core.summary.plan import plan as make_plan
from kb.crawl.share import Part, share
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from kb.store.tables import reading
from kb.youtube.crawl.fetch import PACK
from kb.youtube.crawl.ids import RULES, sorted_by_form
from kb.youtube.crawl.phases import words_of
from kb.youtube.crawl.quota import GENERAL, SEARCH, quota
from kb.youtube.crawl.reduce import (
    CHANNELS,
    PAYLOADS,
    PLAYLIST_SEARCHES,
    PLAYLISTS,
    RAW_LIST,
    RAW_SEARCH,
    RAW_TRANSCRIPTS,
    RAW_VIDEOS,
    SEARCHES,
    TRANSCRIPTS,
    UPLOADS,
    VIDEOS,
)
from kb.youtube.section import YouTubeSection

# Used only where this data root has nothing to measure.
CHANNELS_A_PAGE = 25  # results without duplicates
PLAYLISTS_A_PAGE = 40
VIDEOS_A_CHANNEL = 200
VIDEOS_A_PLAYLIST = 30  # on one page; most of which a channel's uploads list as well
WORTH_A_TRANSCRIPT = 0.6  # of videos, pass category, views, aspect ratio, duration, age
BYTES = {
    RAW_SEARCH: 6_000,
    RAW_LIST: 3_000,
    RAW_VIDEOS: 60_000,
    RAW_TRANSCRIPTS: 12_000,
}  # a call or video
REQUESTS_A_TRANSCRIPT = 3


def plan(run: Run, ids: Path | None = None, part: Part = None) -> Summary:
    """Units, calls, transcript hours, GB and days for what is left. Sends and writes nothing."""
    profile = run.profile.section(YouTubeSection)
    state = _state(run)
    known, assumed = _measured(state)
    if ids:
        left, assumed = _left_of_ids(run, ids, part, state), []
    elif run.again and state["kinds"] and not state["open"]:
        left, assumed = _next_round(profile, state["kinds"]), [NOTHING_NEW]
    else:
        left = _left(state, known)
    calls = {
        "search": left["searches"] + left["playlist_searches"],
        "playlist_items": left["pages"] + left["playlist_pages"],
        "videos": math.ceil(left["videos"] / PACK),
    }
    general = calls["playlist_items"] + calls["videos"]
    hours = _hours(run, left["transcripts"])
    sizes = _bytes_each(run, state)
    answers = {
        RAW_SEARCH: calls["search"],
        RAW_VIDEOS: calls["videos"],
        RAW_TRANSCRIPTS: left["transcripts"],
    }
    gb = {kind: n * sizes[kind] / 1e9 for kind, n in answers.items()}
    asked = left["transcripts"] * REQUESTS_A_TRANSCRIPT
    lists, of_playlists, packs = left["pages"], left["playlist_pages"], calls["videos"]
    a_page = sizes[RAW_LIST] / 1e9
    phases = [
        PlanPhase("searches", calls["search"], calls["search"], gb=gb[RAW_SEARCH]),
        PlanPhase("channels", left["channels"], lists, lists, gb=lists * a_page),
        PlanPhase(
            "playlists", left["playlists"], of_playlists, of_playlists, gb=of_playlists * a_page
        ),
        PlanPhase("videos", left["videos"], packs, packs, gb=gb[RAW_VIDEOS]),
        PlanPhase("transcripts", left["transcripts"], asked, 0, hours, gb[RAW_TRANSCRIPTS]),
    ]
    days = max(
        calls["search"] / profile.searches_per_day, general / profile.units_per_day, hours / 24
    )
    return Summary(
        make_plan(
            "youtube crawl",
            "youtube",
            phases,
            assumed,
            channels=left["channels"],
            playlists=left["playlists"],
            videos=left["videos"],
            transcripts=left["transcripts"],
            searches=calls["search"],
            calls=sum(one.requests for one in phases),
            transcript_hours=round(hours, 1),
            days=round(days, 2),
            searches_left_today=max(0, profile.searches_per_day - state["spent"][SEARCH]),
            units_left_today=max(0, profile.units_per_day - state["spent"][GENERAL]),
        )
    )


def phases_of_known(run: Run, videos: int) -> list[PlanPhase]:
    """So many videos by their ids, and a transcript of each."""
    calls = math.ceil(videos / PACK)
    return [
        PlanPhase("videos", videos, calls, calls, gb=calls * BYTES[RAW_VIDEOS] / 1e9),
        phase_of_tracks(run, "transcripts", videos),
    ]


def phase_of_tracks(run: Run, name: str, tracks: int) -> PlanPhase:
    """So many caption tracks of the web site."""
    asked, gb = tracks * REQUESTS_A_TRANSCRIPT, tracks * BYTES[RAW_TRANSCRIPTS] / 1e9
    return PlanPhase(name, tracks, asked, 0, _hours(run, tracks), gb)


def _hours(run: Run, transcripts: int) -> float:
    """At the profile's pace; on loopback nothing is waited for."""
    if is_loopback(run.settings.kb_youtube_web or ""):
        return 0.0
    return transcripts / run.profile.section(YouTubeSection).transcripts_per_hour


def _state(run: Run) -> dict[str, Any]:
    """Counts of the frontier, as far as there is one."""
    path, section = Layout(run.root).state("youtube"), run.profile.section(YouTubeSection)
    empty: dict[str, Any] = {
        "kinds": {},
        "spent": {SEARCH: 0, GENERAL: 0},
        "searches": {
            kind: len(words) * section.search_pages for kind, words in words_of(section).items()
        },
        "open": False,
    }
    if not path.is_file():
        return empty
    with reading.state(path, PAYLOADS) as frontier:
        return {
            "kinds": frontier.kinds(),
            "open": any(
                frontier.ready(kind)
                for kind in (SEARCHES, PLAYLIST_SEARCHES, UPLOADS, PLAYLISTS, VIDEOS)
            ),
            "spent": {name: quota(section, name).used(frontier) for name in (SEARCH, GENERAL)},
            "searches": {kind: _searches(section, frontier, kind) for kind in words_of(section)},
        }


def _searches(section: YouTubeSection, frontier: Frontier, kind: str) -> int:
    """How many pages of results are left at most."""
    most, words = section.search_pages, set(words_of(section)[kind])
    unread = frontier.items(kind, "todo", "in_progress", "error")
    known = {payload.q for *_, payload in frontier.items(kind) if payload}
    left = sum(max(0, most - payload.page + 1) for *_, payload in unread if payload)
    return left + len(words - known) * most


def _measured(state: dict[str, Any]) -> tuple[dict[str, float], list[str]]:
    """Rates that this data root shows, and the names of those that had to be assumed."""

    def count(kind: str, *statuses: str) -> int:
        counts = state["kinds"].get(kind, {})
        return sum(n for status, n in counts.items() if not statuses or status in statuses)

    rates, assumed = {}, []
    for name, top, bottom, otherwise in (
        ("channels_a_page", count(CHANNELS), count(SEARCHES, "done"), CHANNELS_A_PAGE),
        (
            "playlists_a_page",
            count(PLAYLISTS),
            count(PLAYLIST_SEARCHES, "done"),
            PLAYLISTS_A_PAGE,
        ),
        ("videos_a_channel", count(VIDEOS), count(UPLOADS, "done", "skipped"), VIDEOS_A_CHANNEL),
        ("worth_a_transcript", count(TRANSCRIPTS), count(VIDEOS, "done"), WORTH_A_TRANSCRIPT),
    ):
        rates[name] = top / bottom if bottom else otherwise
        if not bottom:
            assumed.append(f"{name.replace('_', ' ')} {otherwise:g}")
    return rates, assumed


def _next_round(profile: YouTubeSection, kinds: dict[str, dict[str, int]]) -> dict[str, int]:
    """What a new round asks for where nothing is new: the searches of the last one, and the first
    page of each list.
    """
    lists = sum(kinds.get(UPLOADS, {}).values())
    searches = {
        kind: min(sum(kinds.get(kind, {}).values()), len(words) * profile.search_pages)
        for kind, words in words_of(profile).items()
    }
    playlists = sum(kinds.get(PLAYLISTS, {}).values())
    return {
        "searches": searches[SEARCHES],
        "playlist_searches": searches[PLAYLIST_SEARCHES],
        "channels": lists,
        "pages": lists,
        "playlists": playlists,
        "playlist_pages": playlists,
        "videos": 0,
        "transcripts": to_read(kinds, TRANSCRIPTS),
    }


def _left(state: dict[str, Any], rates: dict[str, float]) -> dict[str, int]:
    kinds = state["kinds"]
    searches, for_playlists = state["searches"][SEARCHES], state["searches"][PLAYLIST_SEARCHES]
    playlists = to_read(kinds, PLAYLISTS) + round(for_playlists * rates["playlists_a_page"])
    channels = to_read(kinds, UPLOADS) + round(searches * rates["channels_a_page"])
    unlisted = round(channels * rates["videos_a_channel"])
    videos = to_read(kinds, VIDEOS) + unlisted
    return {
        "searches": searches,
        "playlist_searches": for_playlists,
        "channels": channels,
        "pages": max(channels, math.ceil(unlisted / PACK)),
        "playlists": playlists,
        "playlist_pages": playlists,
        "videos": videos,
        "transcripts": to_read(kinds, TRANSCRIPTS) + round(videos * rates["worth_a_transcript"]),
    }


def _left_of_ids(run: Run, ids: Path, part: Part, state: dict[str, Any]) -> dict[str, int]:
    """A known list: no searches and no lists."""
    mine = share(part)
    asked = RULES.some_ids_in(ids, run.progress.say).keys
    wanted, lists = map(set, sorted_by_form(filter(mine, asked)))
    rates, _ = _measured(state)
    path = Layout(run.root).state("youtube")
    pending = 0
    if path.is_file():
        with reading.state(path) as frontier:
            wanted -= {key for key, *_ in frontier.items(VIDEOS, "done")}
            lists -= {key for key, *_ in frontier.items(PLAYLISTS, "done")}
            pending = frontier.counts(TRANSCRIPTS).get("todo", 0)
    videos = len(wanted) + len(lists) * VIDEOS_A_PLAYLIST
    return {
        "searches": 0,
        "playlist_searches": 0,
        "channels": 0,
        "pages": 0,
        "playlists": len(lists),
        "playlist_pages": len(lists) + math.ceil(len(lists) / PACK),
        "videos": videos,
        "transcripts": pending + round(videos * rates["worth_a_transcript"]),
    }


def _bytes_each(run: Run, state: dict[str, Any]) -> dict[str, float]:
    """Compressed bytes of one call (one video for transcripts), measured where there is
    something.
    """
    answered = {
        RAW_SEARCH: (SEARCHES, 1),
        RAW_LIST: (UPLOADS, 1),
        RAW_VIDEOS: (VIDEOS, PACK),
        RAW_TRANSCRIPTS: (TRANSCRIPTS, 1),
    }
    sizes = {}
    for kind, (items, pack) in answered.items():
        done = state["kinds"].get(items, {}).get("done", 0)
        size = sum(path.stat().st_size for path in rawlog.segments(run.root, "youtube", kind))
        sizes[kind] = size * pack / done if done and size else BYTES[kind]
    return sizes
