"""Stops of a run: `--limit`, spent quotas, blocks; which phases they close, and for how long. The
end of lists that a service never ends.
"""

from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta

from kb.core import clock
from kb.core.errors import Blocked, KbError, LimitReached, QuotaSpent, Retryable, Stopped
from kb.crawl.connector import Phase


class Limit:
    """`--limit N`: how many more items may be taken.

    Not thread-safe by itself.
    """

    def __init__(self, most: int | None) -> None:
        self._most, self._taken = most, 0

    def room(self, wanted: int) -> int:
        """How many of `wanted` items may be taken now."""
        return wanted if self._most is None else min(wanted, self._most - self._taken)

    def take(self, n: int) -> None:
        """Count `n` items as taken; a negative number returns them."""
        self._taken += n

    def reached(self) -> LimitReached:
        """Why the run stops here."""
        return LimitReached(f"--limit {self._most} reached", hint="run the same command to resume")


def check_length(what: str, read: int, most: int) -> None:
    """Call before the next part of a list is asked for: `read` parts came so far, and no real
    service has more than `most`. Raises Retryable: the item fails.
    """
    if read >= most:
        raise Retryable(f"{what} has no end: {read:,} parts of it were read")


def upstream(phases: Sequence[Phase], kind: str) -> set[str]:
    """The kinds whose answers lead to items of `kind`, directly or indirectly."""
    kinds: set[str] = set()
    waiting = [kind]
    while waiting:
        wanted = waiting.pop()
        for phase in phases:
            if wanted in phase.feeds and phase.kind not in kinds and phase.kind != kind:
                kinds.add(phase.kind)
                waiting.append(phase.kind)
    return kinds


def together(phases: Sequence[Phase], phase: Phase, stop: Stopped) -> set[str]:
    """The kinds that a stop of one phase closes: its bucket for a quota, otherwise its service."""
    if isinstance(stop, LimitReached):
        return {phase.kind} | upstream(phases, phase.kind)
    if isinstance(stop, QuotaSpent):
        return {other.kind for other in phases if other.bucket == phase.bucket}
    return {other.kind for other in phases if other.service == phase.service}


def back_at(stops: Iterable[KbError]) -> datetime | None:
    """When the first of the stops ends; None when none of them has an end."""
    times = []
    for stop in stops:
        if isinstance(stop, QuotaSpent) and stop.until is not None:
            times.append(stop.until)
        elif isinstance(stop, Blocked) and stop.after is not None:
            times.append(clock.now() + timedelta(seconds=stop.after))
    return min(times, default=None)
