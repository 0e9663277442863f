"""The key of an annotation: the SHA-256 of the text, so that equal texts share one score."""

from __future__ import annotations

import hashlib
from typing import Any

import pyarrow as pa


def text_hash(text: str) -> str:
    """SHA-256 of the text's UTF-8 bytes, 64 hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def text_hashes(texts: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """`text_hash` of a column; null for a null or empty text, which has nothing to score."""
    sha256 = hashlib.sha256
    values = texts.cast(pa.binary()).to_pylist()
    return pa.array([sha256(value).hexdigest() if value else None for value in values], pa.string())
