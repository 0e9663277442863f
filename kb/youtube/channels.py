"""Channels that ask to be left out, for `kb purge youtube --channels`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from kb.artifacts.purge import Purge
from kb.artifacts.purge_people import PeopleRules, Theirs, in_rows
from kb.artifacts.purge_raw import over_segments
from kb.artifacts.purge_rows import RowLocation, location_of
from kb.store.layout import BELOW
from kb.store.rawlog import rawlog
from kb.youtube.crawl import reduce
from kb.youtube.parse.channels import CHANNEL, KINDS, LISTS, UPLOADS, mark, theirs

TABLES = (
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


def find(purge: Purge, marks: frozenset[str]) -> Iterator[Theirs]:
    """Videos of these channels and the channels' other names, by answers, state and tables.

    Raises DamagedData.
    """
    paths = [path for kind in KINDS for path in rawlog.segments(purge.root, "youtube", kind)]
    work = ((str(path), marks) for path in paths)
    found = {pair for pairs in over_segments(purge.run, paths, _in_segment, work) for pair in pairs}
    for kind in (reduce.CHANNELS, reduce.UPLOADS):
        found |= {(key, "") for key, *_ in purge.frontier.items(kind) if mark(key) in marks}
    for channel in sorted({channel for channel, _ in found}):
        yield Theirs(mark(channel), channel, CHANNEL)
        yield from (Theirs(mark(channel), prefix + channel[2:], UPLOADS) for prefix in LISTS)
    yield from (Theirs(mark(channel), key) for channel, key in sorted(found) if key)
    for location in TABLES:
        yield from in_rows(purge.root, location, "channel_id", marks, mark)


def _in_segment(segment: str, marks: frozenset[str]) -> set[tuple[str, str]]:
    """Channels and videos in the answers of a segment. Runs in a worker."""
    path = Path(segment)
    return {
        (channel, key)
        for _, line in rawlog.Frames(path, checked=True)
        for channel, key in _theirs(path.parent.name, line)
        if mark(channel) in marks
    }


def _theirs(kind: str, line: bytes) -> Iterator[tuple[str, str]]:
    envelope = rawlog.decode(line)
    return theirs(kind, envelope.request.params, envelope.response)


RULES = PeopleRules(
    option="--channels",
    noun="channels",
    hint="write one a line: its id (UC and 22 characters) or an address with /channel/; the page of"
    " a handle (@name) shows the id under About, Share channel",
    parse=channel_id,
    marks=lambda purge, channel: (mark(channel),),
    find=find,
)
