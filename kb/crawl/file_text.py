"""Reads files that users bring: lists of ids, as JSON or as cells, compressed or not; and JSON in
which an unreadable value becomes null or U+FFFD, and the rest of the file is kept.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import json
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any, cast

import msgspec

from kb.core.regular_file import open_regular
from kb.schema.decode import holdable

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # begins with UTF-16's mark
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def opened(path: Path) -> IO[str]:
    """A file's text, decompressed, in the encoding that its first bytes name."""
    file = _unpacked(path)
    start = file.read(4)
    file.seek(0)
    return io.TextIOWrapper(file, encoding=encoding_of(start), newline="")


def encoding_of(start: bytes) -> str:
    """The encoding of a text by its first four bytes: its byte order mark, or the zeros of UTF-16;
    else UTF-8.
    """
    zeros = tuple(number for number, byte in enumerate(start) if not byte)
    unmarked: dict[tuple[int, ...], str] = {(1, 3): "utf-16-le", (0, 2): "utf-16-be"}
    marked = (name for mark, name in _MARKS if start.startswith(mark))
    return next(marked, unmarked.get(zeros, "utf-8"))


def _unpacked(path: Path) -> IO[bytes]:
    with open_regular(path) as file:
        packed = file.read(2) == b"\x1f\x8b"
    return cast("IO[bytes]", gzip.open(path)) if packed else open_regular(path)


def documents(text: str) -> Iterator[Any]:
    """JSON documents that stand one after the other."""
    decoder, place = json.JSONDecoder(), 0
    while place < len(text):
        if text[place].isspace():
            place += 1
            continue
        document, place = decoder.raw_decode(text, place)
        yield document


def delimiter_of(line: str) -> str:
    """What stands between the cells of a header, "" where it is one cell."""
    return next((sign for sign in "\t,;" if sign in line), "")


def cells(lines: Iterable[str], delimiter: str) -> Iterator[list[str]]:
    """The cells of each line, however long. Raises csv.Error."""
    csv.field_size_limit(1 << 30)
    # Titles hold quotation marks; what is between tabs is not quoted.
    if delimiter == "\t":
        return csv.reader(lines, delimiter=delimiter, quoting=csv.QUOTE_NONE)
    return csv.reader(lines, delimiter=delimiter or ",")


def text_of(data: bytes) -> str:
    """The text of a file; what can't be decoded is U+FFFD."""
    return data.decode(encoding_of(data[:4]), errors="replace")


def json_value(text: str) -> Any:
    """A JSON document; null for numbers that are none (NaN, 1e999), U+FFFD for half a character.

    Raises ValueError.
    """
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError):
        pass
    try:
        document = json.loads(text, parse_constant=lambda _: None, parse_float=_finite)
        return holdable(document)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not JSON: {error}") from None


def _finite(text: str) -> float | None:
    number = float(text)
    return number if math.isfinite(number) else None
