"""The key of an annotation: the SHA-256 of the text, so that equal texts share one score."""

from __future__ import annotations

import hashlib
from typing import Any

import pyarrow as pa


def text_hashes(texts: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """SHA-256 of each text's UTF-8 bytes, 64 hexadecimal digits.

    Null for a null or empty text, which has nothing to score.
    """
    sha256 = hashlib.sha256
    values = texts.cast(pa.binary()).to_pylist()
    return pa.array([sha256(value).hexdigest() if value else None for value in values], pa.string())
