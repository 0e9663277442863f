"""Which of the ids that a user named are in a data root.

An id that is nowhere is kept away by a tombstone like any other, and is counted apart:
whoever answers a request for removal has to know whether there was anything to remove.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from kb.artifacts.purge_raw import Matcher, Strip, Texts, over_segments
from kb.core.context import Run
from kb.store.rawlog import rawlog

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


def in_answers(
    run: Run, source: str, keys: Collection[str], texts: Texts, strip: Strip, scratch: Path
) -> set[str]:
    """The keys that raw answers of a source have: those that `strip` takes something away for.

    `texts` of which one is in every such answer, None where answers name items by other words;
    `scratch` is a folder for a work file. Raises Interrupted, DamagedData.
    """
    if texts(keys) is None:
        return set()
    paths = rawlog.all_segments(run.root, source)
    scratch.mkdir(parents=True, exist_ok=True)
    file = scratch / "sought.json"
    file.write_text(json.dumps(sorted(keys)), encoding="utf-8")
    work = ((str(path), str(file), texts, strip) for path in paths)
    try:
        return set().union(*over_segments(run, paths, _in_segment, work))
    finally:
        file.unlink()


def _in_segment(segment: str, keys_file: str, texts: Texts, strip: Strip) -> set[str]:
    """The keys that the answers of a segment have. Runs in a worker."""
    path = Path(segment)
    by_text = defaultdict(set)
    for key in json.loads(Path(keys_file).read_text(encoding="utf-8")):
        for text in texts([key]) or ():
            by_text[text].add(key)
    matches, present = Matcher(by_text), set[str]()
    for _, line in rawlog.Frames(path, checked=True):
        if not matches(line):
            continue
        sought = set().union(*(by_text[text] for text in matches.texts(line))) - present
        envelope = rawlog.decode(line)
        if strip(path.parent.name, envelope, {"": sought}) is not envelope:
            each = ((key, strip(path.parent.name, envelope, {"": {key}})) for key in sought)
            present.update(key for key, left in each if left is not envelope)
    return present


def warn(listed: PurgeList, absent: Mapping[str, str], say: Callable[[str], None]) -> None:
    """Say which entries of a list name no item, and that some items were never here."""
    for entry in listed.unread:
        say(f"unread, as it names no item: {entry[:_WIDTH]!r}")
    if more := listed.bad_lines - len(listed.unread):
        say(f"unread as well: {more:,} more entries")
    unknown = [key for key, why in absent.items() if why == UNKNOWN]
    if unknown:
        what = f"{unknown[0][:_WIDTH]} was" if len(unknown) == 1 else f"{len(unknown):,} ids were"
        first = "" if len(unknown) == 1 else f", the first is {unknown[0][:_WIDTH]}"
        say(f"{what} never in this data root{first}; nothing will bring it in")
