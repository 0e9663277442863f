"""Raw segments → rows spread over buckets, so that all of one key meets in one small place.

A bucket is a fixed share of the keys (by a hash of the key, the same on every machine). Its rows
wait as Arrow files, one for each segment; memory is bounded by a piece of a segment here, and by
a bucket afterwards. The number of buckets follows from the size of the raw data.
"""

from __future__ import annotations

import contextlib
import gc
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.errors import CountMismatch, DamagedData
from kb.schema import raw
from kb.store.rawlog.rawlog import Frames
from kb.store.tables.columns import duplicates, newest

RAW_BYTES = 8 << 20  # compressed raw data a bucket, about 100,000 rows of small answers
MOST = 512
PIECE = 32_768  # rows that are spread at once
LARGE = 1 << 20  # bytes of rows that are spread as they come: joining them would copy them
FULLY_SEARCHED = (
    20  # envelopes of a segment that are all searched for unknown keys; then every hundredth
)


@dataclass(frozen=True)
class RawKind:
    """A raw kind: how its lines become rows, which key names a record, which column decides its
    bucket.

    Of several rows with one key the greatest in the columns `by` stays (null is the least, false
    less than true), then the last one of the raw log. Everything that is joined must share its
    bucket, so `bucket` is the same thing in all kinds (a video's id).

    A kind without `bucket` is read by every bucket: all of it (few rows), or with `named_by`
    (another kind and its column of lists) the rows whose key is named there. `echo` is a boolean
    column, true for a row that says again under another key what a row before it says: no duplicate
    of anything.
    """

    parse: Callable[[Iterable[bytes]], Iterator[pa.Table]]
    key: tuple[str, ...]
    bucket: str = ""
    by: tuple[str, ...] = ("fetched_at",)
    named_by: tuple[str, str] = ("", "")
    echo: str = ""


@contextlib.contextmanager
def without_collecting() -> Iterator[None]:
    """Millions of values and no cycle among them: looking for one costs a tenth of the time."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def how_many(size: int) -> int:
    """Buckets for so many bytes of raw data: a power of two,
    so that a little more data changes nothing.
    """
    wanted = size // RAW_BYTES + 1
    return min(MOST, 1 << (wanted - 1).bit_length())


def spread(
    kind: RawKind,
    name: str,
    segment: Path,
    number: int,
    folder: Path,
    buckets: int,
    *,
    skip_damage: bool = False,
) -> dict[str, Any]:
    """Parse one segment and write `folder/<bucket>/<number>.arrow`.

    Returns rows by bucket, unknown keys as they were seen, and with `skip_damage` the first byte
    that can't be read, if any (the frames around it are read; the tail of an open segment doesn't
    count). Raises DamagedData naming the segment when a line is not an envelope, and without
    `skip_damage` also when something can't be read.
    """
    unknown: Counter[str] = Counter()
    frames = Frames(segment, skip_damage=skip_damage)
    try:
        with without_collecting(), Shuffle(folder, f"{number:06d}", buckets) as shuffle:
            for piece in _pieces(kind.parse(_lines(frames, name, unknown))):
                shuffle.add_rows(piece, piece.column(kind.bucket) if kind.bucket else None)
    except DamagedData as error:
        if error.paths:
            raise
        hint = "move the file away, or copy it again"
        raise DamagedData(f"{segment}: {error}", hint=hint, paths=[segment]) from None
    return {
        "rows": dict(shuffle.rows),
        "unknown": dict(unknown),
        "damaged": frames.first_damaged(),
    }


def _lines(frames: Frames, name: str, unknown: Counter[str]) -> Iterator[bytes]:
    known = name in raw.kinds()
    for number, (_, line) in enumerate(frames):
        if known and (number < FULLY_SEARCHED or number % 100 == 0):
            _count_unknown_keys(line, name, unknown)
        yield line


def _count_unknown_keys(line: bytes, name: str, unknown: Counter[str]) -> None:
    try:
        response = msgspec.json.decode(line).get("response")
    except (ValueError, AttributeError):
        return  # the parser says what is wrong with it
    for path, count in raw.unknown_keys(name, response).items():
        unknown[f"{name.partition('/')[2]}.{path}"] += count


def _pieces(tables: Iterator[pa.Table]) -> Iterator[pa.Table]:
    waiting: list[pa.Table] = []
    for rows in tables:
        waiting.append(rows)
        if sum(part.num_rows for part in waiting) >= PIECE or rows.nbytes >= LARGE:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def read_bucket(folder: Path, written: int) -> list[pa.Table]:
    """What the segments wrote into a bucket. Raises CountMismatch unless these are `written` rows:
    a file that is missing is no empty bucket.
    """
    parts = []
    for path in sorted(folder.glob("*.arrow")):
        with pa.ipc.open_file(pa.memory_map(str(path))) as file:
            parts.append(file.read_all())
    there = sum(part.num_rows for part in parts)
    if there != written:
        raise CountMismatch(
            f"{written:,} rows were written to {folder}, and {there:,} can be read",
            hint="every worker must see the same data root; no output was replaced",
        )
    return parts


def newest_of(
    folder: Path, kind: RawKind, written: int, wanted: pa.Array[Any] | None = None
) -> tuple[pa.Table | None, int]:
    """The newest row of each key of one kind's bucket, and how many others were left out.

    Sorted by key. With `wanted` only the rows whose first key column is in it are read. Echoes
    don't count as left out. Raises CountMismatch as `read_bucket`.
    """
    parts = read_bucket(folder, written)
    if wanted is not None:
        parts = [part.filter(pc.is_in(part[kind.key[0]], value_set=wanted)) for part in parts]
    if not parts:
        return None, 0
    rows = pa.concat_tables(parts)
    kept = newest(rows, kind.key, kind.by)
    return kept, duplicates(rows, kept, kind.echo)


class Shuffle:
    """Writes `folder/<bucket>/<name>.arrow` of every bucket that gets rows. A context manager."""

    def __init__(self, folder: Path, name: str, buckets: int) -> None:
        self._folder, self._name, self._buckets = folder, name, buckets
        self._writers: dict[int, Any] = {}
        self.rows: Counter[int] = Counter()

    def add_rows(self, rows: pa.Table, keys: pa.ChunkedArray[Any] | None) -> None:
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
            self.rows[bucket] += part.num_rows

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
    # Lists of records in many chunks take three times as long.
    rows = rows.combine_chunks().take(pc.sort_indices(numbers))
    counts = {entry["values"]: entry["counts"] for entry in pc.value_counts(numbers).to_pylist()}
    start = 0
    for bucket in sorted(counts):
        yield bucket, rows.slice(start, counts[bucket])
        start += counts[bucket]
