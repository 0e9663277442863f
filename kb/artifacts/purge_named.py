"""Which of the ids that a user named are in a data root.

An id that is nowhere is kept away by a tombstone like any other, and is counted apart:
whoever answers a request for removal has to know whether there was anything to remove.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

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
