"""Four answers and no fifth: every crawled item is kept, rejected, failed or pending. Shares come
with their 95 % intervals.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from kb.core.errors import CountMismatch
from kb.core.summary import phrases, plan


@dataclass(frozen=True, slots=True)
class Tally:
    """How many items got which answer, in one shard, table or source."""

    crawled: int = 0
    kept: int = 0
    rejected: int = 0
    failed: int = 0
    pending: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            *(a + b for a, b in zip(asdict(self).values(), asdict(other).values(), strict=True))
        )

    def balanced(self, what: str) -> Tally:
        """Itself, or CountMismatch when items were lost or doubled."""
        answered = self.kept + self.rejected + self.failed + self.pending
        if answered != self.crawled:
            raise CountMismatch(
                f"{what}: {self.crawled} crawled, but {self.kept} kept + {self.rejected} rejected"
                f" + {self.failed} failed + {self.pending} pending = {answered}",
                hint="this is a bug in Lorecrawl; no output was replaced",
            )
        return self


class Summary(dict[str, Any]):
    """What a command did: the numbers of its last line (`--json`), in order.

    The names are those of kb.core.summary.vocabulary. `command` is the command that ran, `counted`
    the noun that `crawled` counts.
    """

    def line(self) -> str:
        """One line for a person: "youtube crawl: 300 videos crawled, 11 channels, 143 requests".

        Each number stands with its noun; what is nought or for scripts only is left out.
        """
        if "phases" in self:
            return plan.table(self)
        tally = self.get("tally")
        silent: tuple[str, ...] = (*_HEAD, *_ANSWERS) if tally else _HEAD
        if self.get("crawled_in_all") == self.get("crawled"):
            silent += ("crawled_in_all",)  # the first run is all
        parts = [phrases.phrase(name, self[name], self) for name in self if name not in silent]
        if tally:
            parts.insert(0, "; ".join(phrases.tally(of, counts) for of, counts in tally.items()))
            tables = {name.rpartition("/")[2]: n for name, n in self.get("tables", {}).items()}
            if others := {noun: n for noun, n in tables.items() if noun not in tally}:
                parts.insert(1, f"with {phrases.nouns(others)}")
        if left := self.get("left_by"):
            parts.append("left: " + phrases.nouns(left))
        for name in _END:
            why = str(self.get(name) or "")
            parts.append(why if why.startswith(name) or not why else f"{name}: {why}")
        head = f"{self['command']}: " if self.get("command") else ""
        return head + ", ".join(filter(None, parts))


_ANSWERS = ("crawled", "kept", "rejected", "failed", "pending", "missing")
_END = ("stopped", "error")  # why a command ended, after all its numbers
_HEAD = ("command", "source", "counted", *_END)


def remaining(crawled: int, dropped: Iterable[tuple[str, int]]) -> list[tuple[str, int, int]]:
    """(step, rows left, rows dropped) from "crawled" on, where each step drops so many rows."""
    steps = [("crawled", crawled, 0)]
    for step, n in dropped:
        steps.append((step, steps[-1][1] - n, n))
    return steps


_Z = 1.959964  # of the normal distribution, for 95 %


def wilson_interval(hits: float, n: float) -> tuple[float, float]:
    """The 95 % score interval of a share of `n` (Wilson, JASA 1927); (0, 1) where `n` is 0.

    `hits` and `n` may be fractions, as of weighted samples, where `n` is the effective size.
    """
    if n <= 0:
        return 0.0, 1.0
    middle = (hits + _Z * _Z / 2) / (n + _Z * _Z)
    half = _Z * math.sqrt(max(hits * (n - hits), 0) / n + _Z * _Z / 4) / (n + _Z * _Z)
    return max(0.0, middle - half), min(1.0, middle + half)


def interval_text(share: Mapping[str, Any]) -> str:
    """A share with its interval: "0.962 (0.945 to 0.974)"; "-" where there is none."""
    if share.get("share") is None:
        return "-"
    return "{share:.3f} ({low:.3f} to {high:.3f})".format_map(share)


def share_of(hits: int, n: int) -> dict[str, Any]:
    """A share as measures give it: `hits`, `n`, `share` (None where `n` is 0), and the ends `low`
    and `high` of its interval.
    """
    low, high = (round(end, 4) for end in wilson_interval(hits, n))
    share = round(hits / n, 4) if n else None
    return {"hits": hits, "n": n, "share": share, "low": low, "high": high}
