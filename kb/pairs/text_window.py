"""The text around a match, grown word by word on both sides to a drawn number of CLIP tokens.

A share of the tokens that are left is drawn for the left side; the right side takes the rest, and
each gives the other what its end of the transcript can't use. A text has at least `low` tokens
where its transcript has them and never more than `high`: it ends inside a word only where a word
alone is longer than that (text without spaces, addresses).
"""

from __future__ import annotations

from typing import NamedTuple

from kb.core.installation import np
from kb.pairs.clip_tokens import ENDS, Tokens
from kb.pairs.transcript_batch import Text


class Grown(NamedTuple):
    """Texts: first byte, byte after the last (white space may be before it),
    tokens with both ends, first bytes of the first and the last word.
    """

    start: np.ndarray
    end: np.ndarray
    tokens: np.ndarray
    first: np.ndarray
    last: np.ndarray


def grow(
    text: Text,
    counter: Tokens,
    places: tuple[np.ndarray, np.ndarray],
    video: np.ndarray,
    *,
    goal: np.ndarray,
    side: np.ndarray,
    low: int,
    high: int,
) -> Grown:
    """`places`: first byte of the phrase and the one after it; `goal`: tokens drawn; `side`: tokens
    out of `goal` for the left, at most."""
    start, end = places
    words = np.append(text.words, len(text.codes))
    begin = np.searchsorted(words, text.video_at[video])
    stop = np.searchsorted(words, text.video_end[video])
    first = np.searchsorted(words, start, "right") - 1
    after = np.searchsorted(words, end - 1, "right")
    least, most = np.maximum(begin, first - high), np.minimum(stop, after + high)
    counts = counter.of_words(text.codes, words, _within(least, most, len(words)))
    total = np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
    goal = goal - ENDS
    own = total[after] - total[first]
    a = np.maximum(
        np.searchsorted(total, total[first] - np.minimum(side, np.maximum(goal - own, 0)), "left"),
        least,
    )
    a = np.minimum(a, first)
    b = np.clip(np.searchsorted(total, total[a] + goal, "left"), after, most)
    b -= (total[b] - total[a] > high - ENDS) & (b > after)
    short = total[b] - total[a] < goal  # the right side has ended: more from the left
    further = np.clip(np.searchsorted(total, total[b] - goal, "right") - 1, least, a)
    further += (total[b] - total[further] > high - ENDS) & (further < a)
    a = np.where(short, further, a)
    tokens = total[b] - total[a] + ENDS
    grown = Grown(words[a], words[b], tokens, words[a], words[b - 1])
    hard = (tokens > high) | ((tokens < low) & ((a > begin) | (b < stop)))
    for one in np.flatnonzero(hard).tolist():
        begins = (
            (int(start[one]), int(end[one]))
            if tokens[one] > high
            else (int(grown.start[one]), int(grown.end[one]))
        )
        bounds = (int(text.video_at[video[one]]), int(text.video_end[video[one]]))
        grown.start[one], grown.end[one], grown.tokens[one] = _cut(
            text, counter, begins, bounds, goal=max(low, int(goal[one]) + ENDS), high=high
        )
        grown.first[one] = text.words[np.searchsorted(text.words, grown.start[one], "right") - 1]
        grown.last[one] = text.words[np.searchsorted(text.words, grown.end[one]) - 1]
    return grown


def _within(low: np.ndarray, high: np.ndarray, size: int) -> np.ndarray:
    """A mask of what lies in any of the ranges."""
    edges = np.bincount(low, minlength=size + 1) - np.bincount(high, minlength=size + 1)
    return np.cumsum(edges)[:size] > 0


def _cut(
    text: Text,
    counter: Tokens,
    begins: tuple[int, int],
    bounds: tuple[int, int],
    *,
    goal: int,
    high: int,
) -> tuple[int, int, int]:
    """The rare text beside words too long to take whole: grown on, character by character,
    right and then left.
    """
    start, end = begins
    low, top = bounds

    def size(begin: int, finish: int) -> int:
        return counter.count(text.codes[begin:finish].tobytes().decode("utf-8", "replace")) + ENDS

    def inside(place: int) -> bool:
        return low < place < top and bool(text.codes[place] & 0xC0 == 0x80)

    tokens = size(start, end)
    while tokens < goal and end < top:
        place = end + 1
        while inside(place):
            place += 1
        more = size(start, place)
        if more > high:
            break
        end, tokens = place, more
    while tokens < goal and start > low:
        place = start - 1
        while inside(place):
            place -= 1
        more = size(place, end)
        if more > high:
            break
        start, tokens = place, more
    while text.codes[start] == 0x20:
        start += 1
    return start, end, tokens
