"""Raw segments → rows spread over buckets, so that all of one key meets in one small place.

A bucket is a fixed share of the keys (by a hash of the key, the same on every machine). Its rows
wait as Arrow files, one for each segment; memory is bounded by a piece of a segment here, and by
a bucket afterwards. The number of buckets follows from the size of the raw data.
"""

from __future__ import annotations

import gc
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.errors import DamagedData
from kb.schema import raw
from kb.store.rawlog import Frames

RAW_BYTES = 8 << 20  # compressed raw data a bucket, about 100,000 rows of small answers
MOST = 512
PIECE = 32_768  # rows that are spread at once
LOOKED_AT = (
    20  # envelopes of a segment that are all searched for unknown keys; then every hundredth
)


@dataclass(frozen=True)
class Kind:
    """A raw kind: how its lines become rows, which key names a record, which column decides its bucket.

    Of several rows with one key the newest stays (`fetched_at`, then the column `then`, then place in the raw log); with
    `prefer` (a boolean column) a row where it is true beats one where it is not. Everything that is
    joined must share its bucket, so `bucket` is the same thing in all kinds (a video's id).

    A kind without `bucket` is read by every bucket: all of it (few rows), or with `named_by` (another
    kind and its column of lists) the rows whose key is named there. `echo` is a boolean column, true
    for a row that says again under another key what a row before it says: no duplicate of anything.
    """

    parse: Callable[[Iterable[bytes]], Iterator[pa.Table]]
    key: tuple[str, ...]
    bucket: str = ""
    prefer: str = ""
    named_by: tuple[str, str] = ("", "")
    echo: str = ""
    then: str = ""


def how_many(size: int) -> int:
    """Buckets for so many bytes of raw data: a power of two, so that a little more data changes nothing."""
    wanted = size // RAW_BYTES + 1
    return min(MOST, 1 << (wanted - 1).bit_length())


def bucket_of(key: object, buckets: int) -> int:
    """The bucket of a key."""
    return zlib.crc32(str(key).encode("utf-8", "replace")) % buckets


def spread(
    kind: Kind,
    name: str,
    segment: Path,
    number: int,
    folder: Path,
    buckets: int,
    *,
    mending: bool = False,
) -> dict[str, Any]:
    """Parse one segment and write `folder/<bucket>/<number>.arrow`.

    Returns rows, unknown keys as they were seen, and with `mending` the first byte that can't be
    read, if any (the frames around it are read; the tail of an open segment doesn't count). Raises
    DamagedData naming the segment when a line is no envelope, and without `mending` also when
    something can't be read.
    """

    unknown: Counter[str] = Counter()
    writers: dict[int, Any] = {}
    rows, at = 0, 0
    frames = Frames(segment, mending=mending)
    collecting = gc.isenabled()
    gc.disable()  # millions of values and no cycle among them: looking for one costs a tenth of the time
    try:
        for piece in _pieces(kind.parse(_lines(frames, name, unknown))):
            rows += piece.num_rows
            piece = piece.append_column("_at", pa.array(range(at, at + piece.num_rows), pa.int64()))
            at += piece.num_rows
            for bucket, part in _split(piece, kind.bucket, buckets):
                if bucket not in writers:
                    path = folder / str(bucket) / f"{number:06d}.arrow"
                    path.parent.mkdir(parents=True, exist_ok=True)
                    options = pa.ipc.IpcWriteOptions(compression="lz4")
                    writers[bucket] = pa.ipc.new_file(str(path), part.schema, options=options)
                writers[bucket].write_table(part)
    except DamagedData as error:
        if getattr(error, "path", None) is not None:
            raise
        named = DamagedData(
            f"{segment}: {error}", hint="move the file away, or copy it again from where it came"
        )
        named.path = segment  # type: ignore[attr-defined]
        raise named from None
    finally:
        if collecting:
            gc.enable()
        for writer in writers.values():
            writer.close()
    return {
        "rows": rows,
        "unknown": dict(unknown),
        "damaged": frames.first_damaged(),
    }


def _lines(frames: Frames, name: str, unknown: Counter[str]) -> Iterator[bytes]:
    known = name in raw.kinds()
    for number, (_, line) in enumerate(frames):
        if known and (number < LOOKED_AT or number % 100 == 0):
            _look(line, name, unknown)
        yield line


def _look(line: bytes, name: str, unknown: Counter[str]) -> None:
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
        if sum(part.num_rows for part in waiting) >= PIECE:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def _split(rows: pa.Table, column: str, buckets: int) -> Iterator[tuple[int, pa.Table]]:

    if buckets == 1 or not column:
        yield 0, rows
        return
    keys = pc.fill_null(rows.column(column).cast(pa.string()), "None").cast(pa.binary()).to_pylist()
    numbers = pa.array(
        [zlib.crc32(key) % buckets for key in keys], pa.int32()
    )  # bucket_of, inlined
    places = pc.sort_indices(numbers)
    counts = {entry["values"]: entry["counts"] for entry in pc.value_counts(numbers).to_pylist()}
    rows = rows.take(places)
    start = 0
    for bucket in sorted(counts):
        yield bucket, rows.slice(start, counts[bucket])
        start += counts[bucket]


def newest(folder: Path, kind: Kind, wanted: pa.Array | None = None) -> tuple[pa.Table | None, int]:
    """The newest row of each key of one kind's bucket, sorted by key, and how many older ones were left out.

    With `wanted` only the rows whose first key column is in it are read. Echoes don't count as left out.
    """

    paths = sorted(folder.glob("*.arrow")) if folder.is_dir() else []
    if not paths:
        return None, 0
    parts = []
    for number, path in enumerate(paths):
        part = _read(path, kind, wanted)
        parts.append(
            part.append_column("_segment", pa.repeat(pa.scalar(number, pa.int32()), part.num_rows))
        )
    rows = pa.concat_tables(parts)
    by = [
        *kind.key,
        *([kind.prefer] if kind.prefer else []),
        "fetched_at",
        *([kind.then] if kind.then else []),
        "_segment",
        "_at",
    ]
    # nulls first: an answer that doesn't say when it was read is older than any that does
    order = pc.sort_indices(
        rows.select(by), sort_keys=[(name, "ascending", "at_start") for name in by]
    )
    keys = [rows.column(name).take(order).combine_chunks() for name in kind.key]
    last = pa.array([True] * min(1, rows.num_rows), pa.bool_())
    if rows.num_rows > 1:
        same = pa.array([True] * (rows.num_rows - 1), pa.bool_())
        for column in keys:
            same = pc.and_(
                same,
                pc.fill_null(pc.equal(column.slice(0, len(column) - 1), column.slice(1)), False),
            )
        last = pa.concat_arrays([pc.invert(same), last])
    chosen = order.filter(last)
    older = rows.num_rows - len(chosen)
    if kind.echo:
        older -= (
            pc.sum(rows.column(kind.echo)).as_py()
            - pc.sum(rows.column(kind.echo).take(chosen)).as_py()
        )
    return rows.take(chosen).drop_columns(["_segment", "_at"]), older


def _read(path: Path, kind: Kind, wanted: pa.Array | None) -> pa.Table:

    with pa.ipc.open_file(str(path)) as file:
        if wanted is None:
            return file.read_all()
        batches = (file.get_batch(number) for number in range(file.num_record_batches))
        found = [
            batch.filter(pc.is_in(batch.column(kind.key[0]), value_set=wanted)) for batch in batches
        ]
        return pa.Table.from_batches(found, file.schema)
