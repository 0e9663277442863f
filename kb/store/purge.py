"""Removing keys for good, from every file of a data root. Every step may be repeated, so a purge
that was cut off goes on where it stopped: the list of keys stands in state/ until the last step is
done.

The order is the other way round than that of collecting: tombstones first, so that nothing that is
removed can come back meanwhile; then raw, then what was made of it.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple, cast

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import default_workers
from kb.core.engine import make_threads, map_in_order
from kb.store import damage, lock, mending, notes, parquet, purge_search, rawlog, tombstones
from kb.store.atomic import write_bytes, writing
from kb.store.frontier import Frontier
from kb.store.layout import BELOW, Layout, parquet_files, rows_pattern
from kb.store.purge_search import Found
from kb.store.rawlog import Envelope
from kb.store.reading import reading
from kb.store.shards import ShardWriter

Strip = Callable[[str, Envelope, Collection[str]], "Envelope | None"]
"""(kind, envelope, keys) → the envelope without the keys.

The same object when it holds none, None when nothing is left.
"""


class RowLocation(NamedTuple):
    """Where rows of keys stand: folder under the data root, table, and the column that names the
    key.

    A column of bare ids gets `prefix` first where keys are full names (a comment may have a post's
    bare id). With `source` only the rows whose column of that name says so (an id of one source may
    be one of another too).
    """

    folder: str
    table: str
    column: str
    prefix: str = ""
    source: str = ""

    @property
    def pattern(self) -> str:
        """What the files of the table are named like in the folder."""
        return rows_pattern(self.table)

    def values(self, keys: Collection[str]) -> pa.Array[Any]:
        """What the column says of these keys."""
        mine = (key.removeprefix(self.prefix) for key in keys if key.startswith(self.prefix))
        return pa.array(sorted(mine), pa.string())

    def holds(self, rows: pa.RecordBatch, keys: pa.Array[Any]) -> pa.Array[Any]:
        """Which rows are of these keys, as `values` gives them."""
        mine: pa.Array[Any] = pc.is_in(rows.column(self.column).cast(pa.string()), value_set=keys)
        if not self.source:
            return mine
        return cast(
            "pa.Array[Any]",
            pc.and_(mine, pc.equal(rows.column("source").cast(pa.string()), self.source)),
        )

    @property
    def reads(self) -> list[str]:
        """The columns that `holds` looks at."""
        return [self.column, *(["source"] if self.source else [])]


def place_of(name: str, column: str) -> RowLocation:
    """Where a data root has the rows of a declared table: "youtube/videos", "pairs/pairs"."""
    return RowLocation(str(BELOW.table(name)), name, column)


def links_of(source: str) -> RowLocation:
    """Where the entity tables name what a source has."""
    return RowLocation(str(BELOW.links), "links/links", "key", source=source)


def verdicts_of(source: str) -> tuple[RowLocation, ...]:
    """Where a filter says what it did not keep."""
    return tuple(
        RowLocation(str(BELOW.clean(source, verdict)), f"shared/{verdict}", "key")
        for verdict in ("rejected", "failed", "pending")
    )


def begin(root: Path, source: str, reasons: dict[str, str]) -> dict[str, str]:
    """Note what is to go (key → reason), together with what an unfinished purge left;
    its whole list.
    """
    reasons = {**left_over(root, source), **reasons}
    if reasons:
        write_bytes(Layout(root).purge(source), msgspec.json.encode(reasons, order="sorted"))
        tombstones.add(root, source, reasons.items())
    return reasons


def left_over(root: Path, source: str) -> dict[str, str]:
    """The list of a purge that was cut off, {} when none was."""
    mend = f"delete it, then run the `kb purge {source}` again that was cut off"
    return notes.read(Layout(root).purge(source), dict[str, str], mend=mend) or {}


def finish(root: Path, source: str) -> None:
    """Everything is done: nothing of it is left in the state, and the list is forgotten.

    Raises WriterLocked, DiskFull, and DamagedData where raw data could not be read in full: all
    that could be read was purged.
    """
    with lock.writer(root, source):
        frontier = Frontier(Layout(root).state(source))
        try:
            frontier.forget()
            Layout(root).purge(source).unlink(missing_ok=True)
            Layout(root).purged_rows(source).unlink(missing_ok=True)
            # Parts of killed links, which hold keys of all sources, whether there are links or not.
            shutil.rmtree(Layout(root).linking, ignore_errors=True)
            mending.tell(root, source, frontier)
        finally:
            frontier.close()


def rewrite_raw(
    root: Path,
    source: str,
    keys: Collection[str],
    strip: Strip,
    frontier: Frontier,
    found: Found,
    threads: int = 1,
) -> int:
    """Write raw segments again without the keys; how many envelopes changed.

    Call it under the writer's lock, with every segment closed and taken into the frontier. A
    segment keeps its name and place in the order; the new one takes the old one's place by a
    rename. `found` are the frames that may hold a key, as `purge_search.search` says it: no others
    are even read. With one of the `threads` a segment is done before the next one is begun: where
    it says what others lose, a purge that was killed has to find it as it was.
    """
    count = 0
    # Copying lets other threads run.
    with make_threads(threads) as pool:
        tasks = ((path, found[path], keys, strip) for path in in_hand(frontier, found))
        for path, changed in zip(found, map_in_order(pool, rewrite, tasks, threads), strict=True):
            count += changed
            done(frontier, path)
    return count


def in_hand(frontier: Frontier, paths: Iterable[Path]) -> Iterator[Path]:
    """The segments, each of which is written again when it was handed out, until it is `done`.

    Shorter soon: a state that knows more than there is would take it for lost. Killed before it is
    done, it is read again, which changes nothing.
    """
    for path in paths:
        frontier.set_offset(path.parent.name, rawlog.base_name(path), 0)
        yield path


def done(frontier: Frontier, path: Path) -> None:
    """A segment was written again: the state knows all of it."""
    frontier.set_offset(path.parent.name, rawlog.base_name(path), path.stat().st_size)


def stripped(
    path: Path,
    places: Iterable[tuple[int, int]],
    keys: Collection[str],
    strip: Strip,
) -> Iterator[tuple[int, int, Envelope | None]]:
    """The frames (start, end) of a segment that hold keys, and what is left of each envelope;
    `places` are those that may.
    """
    for start, end, line in purge_search.lines(path, places):
        envelope = rawlog.decode(line)
        left = strip(path.parent.name, envelope, keys)
        if left is not envelope:
            yield start, end, left


def rewrite(
    path: Path, places: Iterable[tuple[int, int]], keys: Collection[str], strip: Strip
) -> int:
    """A segment without the keys, as `stripped` has it; how many envelopes changed.

    The caller tells the state, by `in_hand` and `done`.
    """
    return replace(path, stripped(path, places, keys, strip))


def replace(path: Path, left: Iterable[tuple[int, int, Envelope | None]]) -> int:
    """A segment with other envelopes in some of its frames (start, end), in their order, or with
    none there; how many they are.

    The other frames are copied as they stand; a segment in which nothing changes stays.
    """
    engine = rawlog.compressor()
    changes = [
        (start, end, b"" if envelope is None else engine.compress(rawlog.encode(envelope)))
        for start, end, envelope in left
    ]
    if not changes:
        return 0
    with writing(path) as temporary, path.open("rb") as old, temporary.open("wb") as fresh:
        at = 0
        for start, end, frame in changes:
            damage.copy(old, fresh, at, start)
            fresh.write(frame)
            at = end
        damage.copy(old, fresh, at, path.stat().st_size)
    return len(changes)


def drop_rows(root: Path, source: str, places: Iterable[RowLocation], keys: Collection[str]) -> int:
    """Write files of tables again without the rows of `keys`; how many rows went, those included
    that went before this purge was cut off.

    Files without such rows are not touched; order and way of writing stay.
    """
    noted = Layout(root).purged_rows(source)
    gone = notes.read(noted, int, mend="delete it; it counts rows, nothing more") or 0
    values: dict[str, pa.Array[Any]] = {}
    named: dict[Path, list[RowLocation]] = {}  # a file may name keys in several columns
    for place in places:
        if place.prefix not in values:
            values[place.prefix] = place.values(keys)
        for path in sorted((root / place.folder).glob(place.pattern)):
            named.setdefault(path, []).append(place)
    one_by_one = threading.Lock()

    def drop(path: Path) -> None:
        nonlocal gone
        if went := _drop_rows(path, named[path], values):
            with one_by_one:  # noted at once, as the purge may be cut off
                gone += went
                write_bytes(noted, str(gone).encode())

    # Reading and compressing let other threads run.
    with make_threads(default_workers()) as pool:
        for _ in pool.map(drop, named):
            pass
    return gone


def _drop_rows(path: Path, places: list[RowLocation], gone: Mapping[str, pa.Array[Any]]) -> int:
    def good(rows: pa.RecordBatch) -> pa.Array[Any]:
        kept: pa.Array[Any] = pc.invert(
            reduce(pc.or_, [place.holds(rows, gone[place.prefix]) for place in places])
        )
        return kept

    columns = [name for place in places for name in place.reads]
    return _keep(path, places[0].table, list(dict.fromkeys(columns)), good)


def drop_annotations(root: Path, source: str, used: pa.Array[Any] | pa.ChunkedArray[Any]) -> int:
    """Forget scores of texts whose hash is not in `used`: no row has them any more."""
    files = parquet_files(Layout(root).annotations(source))
    return sum(
        _keep(
            path,
            "shared/annotations",
            ["text_hash"],
            lambda rows: pc.is_in(rows.column(0).cast(pa.string()), value_set=used),
        )
        for path in files
    )


def _keep(
    path: Path,
    declared: str,
    columns: list[str],
    good: Callable[[pa.RecordBatch], pa.Array[Any]],
) -> int:
    """Keep the rows that `good` says of a file; how many went. A batch at a time.

    Raises DamagedData for a file that can't be read: it is no empty one.
    """
    with reading([path]), parquet.open_file(path) as file:
        kept = [good(batch) for batch in file.iter_batches(columns=columns)]
        gone = file.metadata.num_rows - sum(pc.sum(mask).as_py() or 0 for mask in kept)
        if gone:
            mask, start = pa.chunked_array(kept, pa.bool_()).combine_chunks(), 0
            with ShardWriter(path, declared, in_order=True) as writer:
                for batch in file.iter_batches():
                    rows = pa.Table.from_batches([batch.filter(mask.slice(start, batch.num_rows))])
                    writer.write(rows)
                    start += batch.num_rows
    return gone
