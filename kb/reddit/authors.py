"""Authors who ask to be left out, for `kb purge reddit --authors`."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

from kb.artifacts.purge import Purge
from kb.artifacts.purge_people import PeopleRules, Theirs, in_rows
from kb.artifacts.purge_raw import Matcher, over_segments
from kb.artifacts.purge_rows import RowLocation
from kb.reddit.parse.anonymize import keyed, load_key, read_key
from kb.reddit.parse.people import PURGED, theirs, without_hashes
from kb.store.layout import BELOW
from kb.store.rawlog import rawlog

TABLES = tuple(
    RowLocation(str(base / short), f"reddit/{short}", key, prefix)
    for base in (BELOW.clean("reddit"), BELOW.reconstructed, BELOW.restored("reddit"))
    for short, key, prefix in (("posts", "post_id", "t3_"), ("comments", "comment_id", "t1_"))
)
_NAME = r"[A-Za-z0-9_-]{1,32}"
# NAME, u/NAME, /user/NAME/comments/…; a person's profile is a subreddit of its own, r/u_NAME.
_PATH = re.compile(rf"/?(?:(?:u|user)/|r/u_)({_NAME})(?:[/?#].*)?", re.IGNORECASE)
_HOST = re.compile(r"(?:https?://)?(?:[\w-]+\.)*reddit\.com(?=/)", re.IGNORECASE)


def name_of(entry: str) -> str | None:
    """The name in a line of a list, None for what names nobody ("[deleted]", a post's address)."""
    host = _HOST.match(entry)
    path = _PATH.fullmatch(entry[host.end() :] if host else entry)
    if path is not None:
        return path[1]
    return entry if host is None and re.fullmatch(_NAME, entry) else None


def marks(purge: Purge, name: str) -> tuple[str, ...]:
    """The hash of a name as answers have it, and as earlier versions made it, which told letter
    cases apart. Raises DamagedData.
    """
    # A plan makes no key: without one there is nobody's name.
    key = (read_key(purge.root) or b"") if purge.dry else load_key(purge.root)
    return tuple(dict.fromkeys((keyed(key, name.lower()), keyed(key, name))))


def find(purge: Purge, people: frozenset[str]) -> Iterator[Theirs]:
    """What these people posted and commented, by answers and tables. Raises DamagedData."""
    paths = rawlog.all_segments(purge.root, "reddit")
    work = ((str(path), people) for path in paths)
    for found in over_segments(purge.run, paths, _in_segment, work):
        for person, names in found.items():
            yield from (Theirs(person, name) for name in names)
    for location in TABLES:
        yield from in_rows(purge.root, location, "author_hash", people)


def _in_segment(segment: str, people: frozenset[str]) -> Mapping[str, set[str]]:
    """Full names in the answers of a segment, by person. Runs in a worker."""
    matches, found = Matcher(people), defaultdict[str, set[str]](set)
    for _, line in rawlog.Frames(Path(segment), checked=True):
        if matches(line):
            envelope = rawlog.decode(line)
            for person in matches.texts(line):
                if (own := without_hashes(envelope, [person])) is not envelope:
                    found[person] |= theirs(own.response) - {PURGED}
    return dict(found)


RULES = PeopleRules(
    option="--authors",
    noun="authors",
    hint="write one a line: NAME, u/NAME or the address of the profile",
    parse=name_of,
    marks=marks,
    find=find,
)
