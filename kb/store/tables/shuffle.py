"""Rows spread over buckets on disk, so that all of one key meets in one small place.

A bucket is a fixed share of the keys, by a hash that is the same on every machine.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import pyarrow as pa
import pyarrow.compute as pc


class Shuffle:
    """Writes `folder/<bucket>/<name>.arrow` of every bucket that gets rows. A context manager."""

    def __init__(self, folder: Path, name: str, buckets: int) -> None:
        self._folder, self._name, self._buckets = folder, name, buckets
        self._writers: dict[int, Any] = {}

    def write(self, rows: pa.Table, keys: pa.ChunkedArray[Any] | None) -> None:
        """Add rows, each to the bucket of its key; all to the first one without `keys`.

        Rows of one bucket keep their order.
        """
        for bucket, part in _split(rows, keys, self._buckets):
            if bucket not in self._writers:
                path = self._folder / str(bucket) / f"{self._name}.arrow"
                path.parent.mkdir(parents=True, exist_ok=True)
                # Not compressed: what is written and read once costs less as it is, and a reader
                # maps it into memory.
                self._writers[bucket] = pa.ipc.new_file(str(path), part.schema)
            self._writers[bucket].write_table(part)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        for writer in self._writers.values():
            writer.close()


def _split(
    rows: pa.Table, keys: pa.ChunkedArray[Any] | None, buckets: int
) -> Iterator[tuple[int, pa.Table]]:
    if buckets == 1 or keys is None:
        yield 0, rows
        return
    named = pc.fill_null(keys.cast(pa.string()), "None").cast(pa.binary()).to_pylist()
    numbers = pa.array([zlib.crc32(key) % buckets for key in named], pa.int32())
    rows = rows.take(pc.sort_indices(numbers))
    counts = {entry["values"]: entry["counts"] for entry in pc.value_counts(numbers).to_pylist()}
    start = 0
    for bucket in sorted(counts):
        yield bucket, rows.slice(start, counts[bucket])
        start += counts[bucket]
