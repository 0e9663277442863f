"""Text of others on a terminal: what would act on it is shown instead.

Titles, names, keys of answers and messages of services may hold escape sequences, C1 controls,
marks that turn the direction of writing, and line breaks that forge a line. None of them reaches
a terminal, a log line or an error as it is; files keep the data exactly.
"""

import codecs
from collections.abc import Sequence
from io import TextIOWrapper
from json import dumps
from typing import Any

_DIRECTION = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
_BREAKS = "\u2028\u2029"
_NAMED = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}
# Characters of a secret that is hidden wherever it stands. A shorter one stands in texts and data
# by chance: to replace "a" would blank the log and hide nothing. No service's keys are as short.
SHORTEST_SECRET = 8


# C0, DEL, C1, direction, line separators, and halves of characters, which no stream can encode.
_ACTS = [*range(0x20), *range(0x7F, 0xA0), *map(ord, _DIRECTION + _BREAKS), *range(0xD800, 0xE000)]
_ONE_LINE = {
    number: f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}" for number in _ACTS
} | {ord(sign): escape for sign, escape in _NAMED.items()}
_LINES = {number: text for number, text in _ONE_LINE.items() if chr(number) not in "\n\t"}
_JSON = {number: f"\\u{number:04x}" for number in _LINES}


def one_line(text: str) -> str:
    """The text in one line, with everything that a terminal would obey written out (`\\x1b`)."""
    return text.translate(_ONE_LINE)


def lines(text: str) -> str:
    """The same where line breaks are the program's own, as in a traceback."""
    return text.translate(_LINES)


def json(text: str) -> str:
    """JSON with the same written as JSON itself escapes it: its values stay what they are."""
    return text.translate(_JSON)


_RAISING = ("strict", "surrogateescape")  # others are what the user has asked for


def escape_unencodable(*streams: object) -> None:
    """Let streams write characters that their encoding lacks as JSON does (`\\u00e9`), so that no
    output ends halfway, and JSON stays JSON.
    """
    codecs.register_error("kb.escape", _escaped)
    for stream in streams:
        if isinstance(stream, TextIOWrapper) and stream.errors in _RAISING:
            stream.reconfigure(errors="kb.escape")


def _escaped(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return dumps(error.object[error.start : error.end])[1:-1], error.end


def table(rows: Sequence[Sequence[str]], least: int = 0) -> list[str]:
    """Rows of cells in columns: the first one to the left, the others at least `least` wide."""
    first, *rest = (max(map(len, column)) for column in zip(*rows, strict=True))
    widths = [max(least, width) for width in rest]
    cells = ((head.ljust(first), *map(str.rjust, others, widths)) for head, *others in rows)
    return ["  ".join(line).rstrip() for line in cells]


_UNITS = (("TB", 10**12), ("GB", 10**9), ("MB", 10**6), ("kB", 10**3))


def size(n: int, digits: int = 1) -> str:
    """1,234,567 bytes as "1.2 MB"."""
    for unit, step in _UNITS:
        if n >= step:
            return f"{n / step:.{digits}f} {unit}"
    return f"{n} B"


def shown(value: Any, most: int = 60) -> str:
    """A value as in TOML or JSON, cut where it is long."""
    as_is = not isinstance(value, (str, bool, list, tuple))
    text = str(value) if as_is else dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= most else text[: most - 1] + "…"
