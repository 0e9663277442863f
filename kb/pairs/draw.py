"""Random numbers that depend on (seed, video id, position of the match, purpose) and nothing else.

SplitMix64 (Steele, Lea, Flood: "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014) over
a key a video, so that whole arrays are drawn at once and no order of work can change a number.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import pyarrow as pa

from kb.core.optional import np

PURPOSES = {
    name: number
    for number, name in enumerate(("rank", "tokens", "side", "center", "clip", "id"), start=1)
}
_GOLDEN = 0x9E3779B97F4A7C15


def video_keys(seed: int, ids: Iterable[str]) -> np.ndarray:
    """64 bits for each video."""
    start = hashlib.sha256(f"{seed}\x1f".encode())
    keys = []
    for one in ids:
        whole = start.copy()
        whole.update(one.encode())
        keys.append(whole.digest()[:8])
    return np.frombuffer(b"".join(keys), "<u8")


def bits(keys: np.ndarray, positions: np.ndarray, purpose: str) -> np.ndarray:
    """64 bits for each match: `keys` of its video, `positions` in its transcript."""
    with np.errstate(over="ignore"):
        start = _mix(keys + np.uint64(PURPOSES[purpose]) * np.uint64(0xD1342543DE82EF95))
        return _mix(start + (positions.astype(np.uint64) + np.uint64(1)) * np.uint64(_GOLDEN))


def whole(drawn: np.ndarray, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
    """Bits as whole numbers from `low` to `high`, both included."""
    share = (drawn >> np.uint64(11)).astype(np.float64) * 2.0**-53
    numbers: np.ndarray = low + np.floor(share * (np.maximum(high, low) - low + 1)).astype(np.int64)
    return numbers


def hexadecimal(drawn: np.ndarray) -> pa.Array[Any]:
    """Bits as sixteen hexadecimal digits."""
    digits = np.frombuffer(b"0123456789abcdef", np.uint8)
    codes = drawn.astype(">u8").view(np.uint8)
    text = np.stack((digits[codes >> 4], digits[codes & 15]), axis=1).tobytes()
    offsets = np.arange(0, 16 * len(drawn) + 1, 16, dtype=np.int32)
    return pa.StringArray.from_buffers(len(drawn), pa.py_buffer(offsets.data), pa.py_buffer(text))


def _mix(value: np.ndarray) -> np.ndarray:
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: np.ndarray = value ^ (value >> np.uint64(31))
    return mixed
