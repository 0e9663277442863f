"""Evens out case, punctuation and spaces of UTF-8 text, and knows where each byte came from.

A word is a run of letters, digits and combining marks; everything else separates words. Invisible
characters (soft hyphen, joiners, variation selectors) vanish. Scripts that don't write spaces form
long words; a keyword is found in them only where something separates it.
"""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from kb.core.optional import np

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
    return " ".join(out.replace(bytes([_GONE]), b"").decode().split())


class Folded:
    """Folded bytes of a buffer that begins and ends with a space. `origin` maps positions back.

    `wide`: where characters beyond ASCII begin, for whom it is known.
    """

    def __init__(self, raw: bytes, wide: np.ndarray | None = None) -> None:
        data = raw.translate(ASCII)
        codes = np.frombuffer(data, np.uint8)
        if wide is None:
            wide = np.flatnonzero(codes >= 0xC2)
            wide = wide[codes[wide] != WALL]
        vanished = False
        if len(wide):
            codes = codes.copy()
            vanished = _fold_wide(codes, wide)
        space = codes == 0x20
        if vanished:  # what vanishes must not part a run of spaces
            gone = codes == _GONE
            kept = np.flatnonzero(~gone)
            gone[kept[1:]] = space[kept[1:]] & space[kept[:-1]]
            dropped = np.flatnonzero(gone)
        else:
            dropped = np.flatnonzero(space[1:] & space[:-1]) + 1
        # Where each dropped byte would be in the folded text.
        self._before = dropped - np.arange(len(dropped))
        self.bytes: bytes = data
        if len(dropped):
            keep = np.ones(len(codes), bool)
            keep[dropped] = False
            self.bytes = codes[keep].tobytes()
        elif len(wide):
            self.bytes = codes.tobytes()

    def origin(self, positions: np.ndarray) -> np.ndarray:
        """Positions in the buffer of positions in `bytes`."""
        return positions + np.searchsorted(self._before, positions, "right")


def _fold_wide(codes: np.ndarray, leads: np.ndarray) -> bool:
    """Fold characters of two to four bytes in place, each different one once.

    Tells whether any of their bytes vanish.
    """
    first = codes[leads]
    size = np.where(first >= 0xF0, 4, np.where(first >= 0xE0, 3, 2))
    vanish = False
    for length in (2, 3, 4):
        at = leads[size == length]
        if not len(at):
            continue
        places = at[:, None] + np.arange(length)
        seen, which = np.unique(
            np.ascontiguousarray(codes[places]).view(f"V{length}").ravel(), return_inverse=True
        )
        new = np.frombuffer(
            b"".join(character(bytes(one).decode("utf-8", "replace")[:1]) for one in seen.tolist()),
            np.uint8,
        )
        codes[places] = new.reshape(-1, length)[which]
        vanish = vanish or bool((new == _GONE).any())
    return vanish
