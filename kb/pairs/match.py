"""Finds every keyword of a batch: whole words, case-folded, leftmost-longest, across cues.

One Aho-Corasick automaton over bytes with the spaces around a phrase in the pattern, all matches
with overlaps, then the leftmost and among them the longest. (Asking the automaton itself for
leftmost-longest and testing word boundaries afterwards loses matches: "oak log" hides "oak" in
"oak logic".)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from ahocorasick_rs import BytesAhoCorasick, Implementation

from kb.core.optional import np
from kb.pairs.fold import Folded


class KeywordMatches(NamedTuple):
    """Matches in order: the phrase's number, its first byte and the byte after its last,
    in the text.
    """

    phrase: np.ndarray
    start: np.ndarray
    end: np.ndarray


# With other first bytes than the space the automaton just goes on, and does not look for the next
# space, of which texts have one every five bytes. No text has these (RFC 3629, section 3).
_NEVER = [bytes([byte]) for byte in (0xFA, 0xFB, 0xFC, 0xFD)]


class Matcher:
    """Matches folded phrases."""

    def __init__(self, phrases: Sequence[str]) -> None:
        self._automaton = _automaton(tuple(phrases)) if phrases else None

    def find(self, raw: bytes) -> KeywordMatches:
        """Matches in UTF-8 text that begins and ends with a space."""
        folded = Folded(raw)
        hits = (
            self._automaton.find_matches_as_indexes(folded.bytes, overlapping=True)
            if self._automaton
            else []
        )
        flat = np.fromiter(chain.from_iterable(hits), np.int64, 3 * len(hits)).reshape(-1, 3)
        phrase, start, end = flat[:, 0], flat[:, 1] + 1, flat[:, 2] - 1
        kept = leftmost_longest(start, end)
        phrase, start, end = phrase[kept], start[kept], end[kept]
        return KeywordMatches(
            phrase, folded.origin(start), folded.origin(end - 1) + 1 if len(end) else end
        )


@lru_cache(maxsize=2)  # one command matches with the same phrases again
def _automaton(phrases: tuple[str, ...]) -> BytesAhoCorasick:
    return BytesAhoCorasick(
        [*(f" {one} ".encode() for one in phrases), *_NEVER], implementation=Implementation.DFA
    )


def leftmost_longest(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Which of the overlapping matches stay, in order: the first, of equal starts the longest,
    then on from its end.
    """
    order = np.lexsort((-end, start))
    begin, finish = start[order], end[order]
    kept = np.zeros(len(order), bool)
    left = np.arange(len(order))  # undecided matches, in order
    while len(left):
        reach = np.maximum.accumulate(finish[left])
        head = np.concatenate(
            ([True], begin[left][1:] >= reach[:-1])
        )  # nothing undecided before overlaps it
        kept[left[head]] = True
        group = np.cumsum(head) - 1
        taken = finish[left[head]][group]
        left = left[~head & (begin[left] >= taken)]
    return order[kept]
