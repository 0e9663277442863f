"""What a purge has to know about YouTube: videos and playlists that vanished leave everything, and
for `--channels` all videos and playlists of channels that ask to be left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from kb.artifacts.purge import Purge, PurgeRules, by_presence, with_named
from kb.artifacts.purge_people import PeopleRules, Theirs, in_rows
from kb.artifacts.purge_raw import over_segments
from kb.artifacts.purge_rows import RowLocation, location_of, shared_locations
from kb.store.atomic import remove_path
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog
from kb.youtube.crawl.ids import RULES as IDS
from kb.youtube.crawl.reduce import (
    CHANNELS,
    PLAYLIST_FACTS,
    PLAYLISTS,
    RAW_FACTS,
    RAW_VIDEOS,
    REFRESH,
    SECOND_TRACKS,
    STATISTICS,
    TRANSCRIPTS,
    UPLOADS,
    VIDEOS,
)
from kb.youtube.crawl.refresh import newest
from kb.youtube.parse.channels import CHANNEL, KINDS, LISTS, mark, theirs
from kb.youtube.parse.channels import UPLOADS as UPLOADS_LIST

CHANNEL_COLUMNS = (
    location_of("youtube/videos", "video_id"),
    RowLocation(str(BELOW.clean("youtube", "rejected")), "shared/rejected", "key"),
    RowLocation(str(BELOW.restored("youtube", "videos")), "youtube/videos", "video_id"),
)
_ID = r"UC[A-Za-z0-9_-]{22}"
_ADDRESS = re.compile(rf"(?i:(?:https?://)?(?:[\w-]+\.)*youtube\.com)?/channel/({_ID})(?:[/?#].*)?")


def channel_id(entry: str) -> str | None:
    """The channel that a line of a list names, None where it names none: what channel a handle is
    of only YouTube knows.
    """
    if re.fullmatch(_ID, entry):
        return entry
    match = _ADDRESS.fullmatch(entry)
    return match[1] if match else None


def find_channels(purge: Purge, marks: frozenset[str]) -> Iterator[Theirs]:
    """Videos of these channels and the channels' other names, by answers, state and tables.

    Raises DamagedData.
    """
    paths = [path for kind in KINDS for path in rawlog.segments(purge.root, "youtube", kind)]
    work = ((str(path), marks) for path in paths)
    named = {pair for pairs in over_segments(purge.run, paths, _in_segment, work) for pair in pairs}
    for kind in (CHANNELS, UPLOADS):
        named |= {(key, "") for key, *_ in purge.frontier.items(kind) if mark(key) in marks}
    for channel in sorted({channel for channel, _ in named}):
        yield Theirs(mark(channel), channel, CHANNEL)
        yield from (Theirs(mark(channel), prefix + channel[2:], UPLOADS_LIST) for prefix in LISTS)
    yield from (Theirs(mark(channel), key) for channel, key in sorted(named) if key)
    for location in CHANNEL_COLUMNS:
        yield from in_rows(purge.root, location, "channel_id", marks, mark)


def _in_segment(segment: str, marks: frozenset[str]) -> set[tuple[str, str]]:
    """Channels and videos in the answers of a segment. Runs in a worker."""
    path, named = Path(segment), set[tuple[str, str]]()
    for _, line in rawlog.Frames(path, checked=True):
        envelope = rawlog.decode(line)
        pairs = theirs(path.parent.name, envelope.request.params, envelope.response)
        named.update(pair for pair in pairs if mark(pair[0]) in marks)
    return named


def marks(purge: Purge, channel: str) -> tuple[str, ...]:
    """The marks by which a channel is kept away."""
    return (mark(channel),)


PEOPLE = PeopleRules(
    option="--channels",
    noun="channels",
    hint="write one a line: its id (UC and 22 characters) or an address with /channel/; the page of"
    " a handle (@name) shows the id under About, Share channel",
    parse=channel_id,
    marks=marks,
    find=find_channels,
)


def find(purge: Purge) -> dict[str, str]:
    """What the user named, and videos and playlists that the API no longer returns ("vanished")."""
    read = newest(purge.root, RAW_VIDEOS) | newest(purge.root, RAW_FACTS)
    vanished = dict.fromkeys((key for key, last in read.items() if not last.there), "vanished")
    return with_named(by_presence(purge), vanished)


def forget(purge: Purge) -> None:
    """Forget channels that are left out, and what was seen of films of removed videos."""
    for kind in (CHANNELS, UPLOADS):
        purge.frontier.remove(kind, purge.names.get(CHANNEL, ()))
    for key in purge.keys:
        (Layout(purge.root).scoring / f"{key}.json").unlink(missing_ok=True)
        remove_path(Layout(purge.root).films / key)


RULES = PurgeRules(
    "youtube",
    IDS.some_ids_in,
    rows=(
        *(location_of(f"youtube/{name}", "video_id") for name in ("videos", "transcripts")),
        location_of("pairs/pairs", "video_id"),
        location_of("pairs/quality", "video_id"),
        location_of("pairs/scores", "video_id"),
        *(location_of(f"films/{name}", "video_id") for name in ("shots", "film_figures")),
        *(location_of(f"tasks/{name}", "video_id") for name in ("tasks", "titles")),
        location_of("youtube/playlists", "playlist_id"),
        location_of("youtube/playlist_videos", "playlist_id"),
        location_of("youtube/playlist_videos", "video_id"),
        location_of("open-text/open_text", "video_id"),
        location_of("labels/labels", "video_id"),
        *shared_locations("youtube"),
        *(
            RowLocation(str(BELOW.restored("youtube", name)), f"youtube/{name}", "video_id")
            for name in ("videos", "transcripts")
        ),
        RowLocation(str(BELOW.restored("youtube")), "shared/missing", "key"),
        RowLocation(str(BELOW.restored("pairs")), "pairs/pairs", "video_id"),
        RowLocation(str(BELOW.restored("draw")), "draw/draw", "video_id"),
    ),
    items=(
        *(VIDEOS, TRANSCRIPTS, REFRESH, STATISTICS, SECOND_TRACKS),
        *(PLAYLISTS, PLAYLIST_FACTS),
    ),
    find=find,
    forget=forget,
    people=PEOPLE,
)
