"""Text and JSON of files as people have them: one odd value costs that value, never the file."""

import json
import math
from typing import Any

import msgspec

from kb.crawl.list_text import encoding_of
from kb.schema.decode import holdable


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
