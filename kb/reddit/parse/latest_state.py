"""The newest state of each post and comment, without texts: the basis of refresh and purge.

The rows of the raw log are partitioned into buckets on disk, as in `kb reddit filter`, and each
bucket is reduced to one row per thing. Memory is bounded by a piece of a segment, then by a bucket.
"""

import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import Run
from kb.core.engine import executor_of, map_in_order
from kb.reddit.parse import answers as parse
from kb.reddit.section import Links, RedditSection
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.tables import partition
from kb.store.tables.columns import aligned, newest, put

COLUMNS = ("fullname", "post_id", "state", "fetched_at", "live", "gone", "undated", "dump")


class LatestState:
    """Iterates tables of `fullname, post_id, fetched_at, live, gone, there`, one row per thing, any
    number of times.

    Each table has a share of the things. `post_id` is null when no answer names it, `fetched_at`
    when a dump does not; `gone` is why a thing was removed (null: it was not), `there` is false if
    the service no longer has it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.written: Counter[int] = Counter()  # rows by bucket

    def __iter__(self) -> Iterator[pa.Table]:
        for bucket, rows in sorted(self.written.items()):
            yield _newest(partition.read_bucket(self.folder / str(bucket), rows))


@contextmanager
def latest_state(run: Run, folder: Path | None = None) -> Iterator[LatestState]:
    """The state of all things, in a folder that is deleted at the end. The caller holds the
    writer's lock, or gives another `folder`.

    Stubs and things without an id are left out. Raises DamagedData, CountMismatch, DiskFull and
    Interrupted.
    """
    folder = folder or Layout(run.root).known("reddit")
    shutil.rmtree(folder, ignore_errors=True)  # of a killed run
    folder.mkdir(parents=True)
    things = LatestState(folder)
    try:
        segments = [
            (kind, path)
            for kind in parse.KINDS
            for path in rawlog.segments(run.root, "reddit", kind)
        ]
        size = sum(path.stat().st_size for _, path in segments)
        links, number = run.profile.section(RedditSection).links, partition.how_many(size)
        tasks = (
            (kind, links, str(path), place, str(folder), number)
            for place, (kind, path) in enumerate(segments)
        )
        with (
            executor_of(run, size) as executor,
            run.progress.task("read reddit", total=len(segments), unit="raw files") as task,
        ):
            for rows in map_in_order(executor, spread, tasks, window=executor.window):
                things.written.update(rows)
                task.advance(1)
        yield things
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def spread(
    kind: str, links: Links, segment: str, place: int, folder: str, number: int
) -> dict[int, int]:
    """Spread a segment: `folder/<bucket>/<place>.arrow` of `number` buckets; rows by bucket.
    Runs in a worker.
    """
    about = partition.RawKind(
        partial(_rows, kind=kind, links=links), key=("fullname",), bucket="fullname"
    )
    with full_disk_is_resumable(Path(folder)):
        done = partition.spread(about, f"reddit/{kind}", Path(segment), place, Path(folder), number)
    return dict(done["rows"])


def _rows(lines: Iterable[bytes], kind: str, links: Links) -> Iterator[pa.Table]:
    """Posts and comments that an answer shows or misses; stubs and marks are left out."""
    states = pa.array(["there", "missing"])
    for rows in parse.rows(lines, kind, links):
        yield rows.filter(pc.is_in(rows["state"], value_set=states)).select(COLUMNS)


def _newest(parts: list[pa.Table]) -> pa.Table:
    """One row a thing of a bucket."""
    rows = pa.concat_tables(parts)
    # As in assemble the later kind wins between answers of the same age: segments are in the order
    # of the kinds, dumps first.
    copies = newest(rows.filter(pc.invert(rows["live"])), ["fullname"], parse.COPIES)
    answered = pa.concat_tables([copies, rows.filter(rows["live"])])
    latest = newest(answered, ["fullname"], ["fetched_at"])
    # An answer that a comment is gone may not name its post; an older answer does.
    named = rows.filter(pc.greater(pc.binary_length(rows["post_id"]), 0))
    named = newest(named, ["fullname"], ["fetched_at", "live", "dump"])
    posts = aligned(named, "fullname", latest["fullname"])["post_id"]
    there = pc.equal(latest["state"], "there")
    latest = latest.drop_columns(["state", "undated", "dump"]).append_column("there", there)
    return put(latest, "post_id", posts)
