"""Which of the ids that a user named are in a data root.

An id that is nowhere is kept away by a tombstone like any other, and is told apart: whoever
answers a request for removal has to know whether there was anything to remove.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from kb.artifacts.purge_raw import Matcher, over_segments
from kb.artifacts.purge_rows import keys_in_rows, released
from kb.store.rawlog import rawlog
from kb.store.state import tombstones

if TYPE_CHECKING:
    from kb.artifacts.purge import Purge, PurgeRules

NAMED = "named"  # is or was in the data root until this purge
KNOWN = "known"  # was purged before
UNKNOWN = "unknown"  # was never there

ABSENT = (KNOWN, UNKNOWN)

_WIDTH = 100  # characters of an entry that are shown


class PurgeList(Protocol):
    """The items that a user named."""

    @property
    def keys(self) -> list[str]:
        """The ids, each once."""

    @property
    def bad_lines(self) -> int:
        """How many entries name no item."""

    @property
    def unread(self) -> Sequence[str]:
        """The first of these entries, as they stand in the list."""


def by_presence(purge: Purge) -> dict[str, str]:
    """Each key that the user named, with NAMED, KNOWN or UNKNOWN.

    A key is in the data root when the frontier, a table or a raw answer has it; the raw answers are
    read for those that are neither in the state nor in a table.
    """
    keys = purge.listed.keys if purge.listed else []
    before = tombstones.keys(purge.root, purge.rules.source)
    sought = {key for key in keys if key not in before}
    for where in (_in_state, _in_rows, _in_answers):
        if sought:
            sought -= where(purge, sought)
    return {key: KNOWN if key in before else UNKNOWN if key in sought else NAMED for key in keys}


def _in_state(purge: Purge, keys: Collection[str]) -> set[str]:
    return {key for kind in purge.rules.items for key in keys if purge.frontier.get(kind, key)}


def _in_rows(purge: Purge, keys: Collection[str]) -> set[str]:
    locations = (*purge.rules.rows, *released(purge.rules.rows))
    return keys_in_rows(purge.root, locations, keys)


def _in_answers(purge: Purge, keys: Collection[str]) -> set[str]:
    if purge.rules.texts(keys) is None:  # answers name such items by other words
        return set()
    paths = rawlog.all_segments(purge.root, purge.rules.source)
    purge.scratch.mkdir(parents=True, exist_ok=True)
    file = purge.scratch / "sought.json"
    file.write_text(json.dumps(sorted(keys)), encoding="utf-8")
    work = ((str(path), purge.rules, str(file)) for path in paths)
    try:
        return set().union(*over_segments(purge.run, paths, _in_segment, work))
    finally:
        file.unlink()


def _in_segment(segment: str, rules: PurgeRules, keys_file: str) -> set[str]:
    """The keys that the answers of a segment have. Runs in a worker."""
    path = Path(segment)
    by_text = defaultdict(set)
    for key in json.loads(Path(keys_file).read_text(encoding="utf-8")):
        for text in rules.texts([key]) or ():
            by_text[text].add(key)
    matches, found = Matcher(by_text), set[str]()
    for _, line in rawlog.Frames(path, checked=True):
        if not matches(line):
            continue
        sought = set().union(*(by_text[text] for text in matches.texts(line))) - found
        envelope = rawlog.decode(line)
        if rules.strip_envelope(path.parent.name, envelope, {"": sought}) is envelope:
            continue
        for key in sought:
            if rules.strip_envelope(path.parent.name, envelope, {"": {key}}) is not envelope:
                found.add(key)
    return found


def warn(listed: PurgeList, absent: Mapping[str, str], say: Callable[[str], None]) -> None:
    """Say which entries of a list name no item, and that some items were never here."""
    for entry in listed.unread:
        say(f"unread, as it names no item: {entry[:_WIDTH]!r}")
    if more := listed.bad_lines - len(listed.unread):
        say(f"unread as well: {more:,} more")
    unknown = [key for key, why in absent.items() if why == UNKNOWN]
    if unknown:
        what = f"{unknown[0][:_WIDTH]} was" if len(unknown) == 1 else f"{len(unknown):,} ids were"
        first = "" if len(unknown) == 1 else f", the first is {unknown[0][:_WIDTH]}"
        say(f"{what} never in this data root{first}; nothing will bring it in")
