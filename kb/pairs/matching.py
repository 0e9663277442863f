"""Matches keywords in UTF-8 text, ignoring case, punctuation and extra spaces.

A word is a run of letters, digits and combining marks; everything else separates words. Invisible
characters (soft hyphen, joiners, variation selectors) vanish. In scripts without spaces (Chinese,
Japanese, Thai, Khmer) each sign is a word, so that a keyword is found wherever its signs stand.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from ahocorasick_rs import BytesAhoCorasick, Implementation

from kb.core import scripts
from kb.core.installation import np

WALL = 0xFF  # between texts: no byte of UTF-8, so no phrase reaches across
_GONE = 0x00

# ASCII: letters to lower case, digits kept, all else to a space. Bytes of longer characters stay
# for now.
ASCII = bytes(
    byte if byte >= 0x80 else ord(chr(byte).lower()) if chr(byte).isalnum() else 0x20
    for byte in range(256)
)


@lru_cache(maxsize=65_536)
def character(char: str) -> bytes:
    """What one character beyond ASCII becomes, in as many bytes as it had."""
    size = len(char.encode())
    kind = unicodedata.category(char)
    if (kind == "Cf" and char != "\u200b") or "\ufe00" <= char <= "\ufe0f":
        return bytes([_GONE]) * size
    if kind[0] not in "LNM":
        return b" " * size
    for folded in (char.casefold(), char.lower()):
        if len(folded.encode()) <= size and all(
            part.isalnum() or unicodedata.category(part)[0] == "M" for part in folded
        ):
            return folded.encode().ljust(size, bytes([_GONE]))
    return char.encode()


def phrase(text: str) -> str:
    """A keyword as it stands in folded text: its words, with one space between them."""
    if text.isascii():
        return " ".join(text.encode().translate(ASCII).decode().split())
    out = b"".join(
        bytes([ASCII[ord(char)]]) if ord(char) < 0x80 else character(char) for char in text
    )
    return " ".join(scripts.words(out.replace(bytes([_GONE]), b"").decode()))


class Folded:
    """Folded bytes of a buffer that begins and ends with a space. `origin` maps positions back."""

    def __init__(self, raw: bytes) -> None:
        codes = np.frombuffer(bytearray(raw.translate(ASCII)), np.uint8)
        begins, ends = _fold_wide(codes)
        dropped = codes == _GONE
        kept = np.flatnonzero(~dropped) if dropped.any() else slice(None)
        space = codes[kept] == 0x20  # invisible characters don't part a run of spaces
        repeated = np.append(False, space[1:] & space[:-1])
        dropped[kept] = repeated
        places = np.flatnonzero(dropped)
        # Where each dropped byte would be in the folded text.
        self._before = places - np.arange(len(places))
        codes = codes[~dropped]
        # A space on both sides of each sign that is a word, where there is none.
        begins, ends = (at - np.searchsorted(places, at) for at in (begins, ends))
        ends = np.setdiff1d(ends, begins)
        spaces = np.union1d(begins[codes[begins - 1] != 0x20], ends[codes[ends] != 0x20])
        self._added = spaces + np.arange(len(spaces))
        self.bytes: bytes = (np.insert(codes, spaces, 0x20) if len(spaces) else codes).tobytes()

    def origin(self, positions: np.ndarray) -> np.ndarray:
        """Positions in the buffer of positions in `bytes`, none of them an added space."""
        positions = positions - np.searchsorted(self._added, positions)
        return positions + np.searchsorted(self._before, positions, "right")


def _fold_wide(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fold characters of two to four bytes in place, each different one once. Returns where signs
    of scripts without spaces begin, and the bytes behind them, both in order.
    """
    begins = [np.zeros(0, np.int64)]
    ends = [np.zeros(0, np.int64)]
    leads = np.flatnonzero((codes >= 0xC2) & (codes != WALL))
    first = codes[leads]
    size = np.where(first >= 0xF0, 4, np.where(first >= 0xE0, 3, 2))
    for length in (2, 3, 4):
        places = leads[size == length][:, None] + np.arange(length)
        characters, which = np.unique(codes[places], axis=0, return_inverse=True)
        texts = [character.tobytes().decode("utf-8", "replace")[:1] for character in characters]
        folded = b"".join(map(character, texts))
        codes[places] = np.frombuffer(folded, np.uint8).reshape(-1, length)[which]
        signs = np.array([scripts.is_word(text) for text in texts], bool)
        begins.append(places[signs[which], 0])
        ends.append(places[signs[which], 0] + length)
    return np.sort(np.concatenate(begins)), np.sort(np.concatenate(ends))


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
        [*(f" {phrase} ".encode() for phrase in phrases), *_NEVER],
        implementation=Implementation.DFA,
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
