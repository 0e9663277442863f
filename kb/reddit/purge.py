"""What of Reddit's data must go: what its author deleted, moderators removed, the service no longer
has, or a person named.

Keys are full names. The comments of a purged post go with it, from raw and from every table (reason
`post`): their addresses hold its title. Replies to a purged comment stay.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Collection, Iterator
from functools import lru_cache
from pathlib import Path
from typing import cast

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.verdict import Summary
from kb.crawl.purge import PurgeKeys, collected
from kb.crawl.session import open_session
from kb.reddit.connector.ids import read_wanted
from kb.reddit.connector.source import INFO, RedditSource
from kb.reddit.parse import comment_counts as threads
from kb.reddit.parse import tree
from kb.reddit.parse.crossposts import crossposts_of, drop_parents
from kb.reddit.parse.latest_state import known
from kb.reddit.parse.remove_ids import strip
from kb.store import mending, parquet, purge, purge_plan, rawlog, tombstones
from kb.store.frontier import Frontier
from kb.store.layout import BELOW, Layout
from kb.store.purge import RowLocation, links_of, verdicts_of
from kb.store.purge_search import Holds, everything, finder
from kb.store.rawlog import Envelope
from kb.store.reading import reading
from kb.store.shards import write_table

_MUCH = 64 << 20  # bytes of segments that are written again by several processes
_MANY = 2_000  # keys: from here on every answer is decoded without a search
REBUILT = (BELOW.reconstructed, BELOW.restored("reddit"))
BASES = (BELOW.clean("reddit"), *REBUILT)
ROWS = (
    *(
        place
        for base in BASES
        for place in (
            RowLocation(str(base / "posts"), "reddit/posts", "post_id", "t3_"),
            RowLocation(str(base / "comments"), "reddit/comments", "comment_id", "t1_"),
            RowLocation(str(base / "comments"), "reddit/comments", "post_id", "t3_"),
        )
    ),
    *(RowLocation(str(base), "reddit/missing", "key") for base in REBUILT),
    RowLocation(str(BELOW.restored()), "shared/missing", "key"),
    *verdicts_of("reddit"),
    links_of("reddit"),
)


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge reddit` would remove, counted. Changes nothing."""
    with tempfile.TemporaryDirectory(prefix="lorecrawl-plan-") as scratch:
        found = collect(run, ids, Path(scratch, "known"))
    return purge_plan.plan(run.root, "reddit", found, strip, ROWS, holding)


def collect(run: Run, ids: Path | None, scratch: Path | None = None) -> dict[str, str]:
    """What is to go and why: `deleted`, `removed`, `missing`, `named`, and `post` for comments of
    posts that go.
    """
    found: dict[str, str] = {}
    if ids:
        wanted = read_wanted(ids)
        found = dict.fromkeys([*wanted.names, *(f"t3_{key}" for key in wanted.trees)], "named")
    with known(run, scratch) as things:
        for rows in things:
            lost = rows.filter(pc.or_(pc.invert(rows["there"]), pc.is_valid(rows["gone"])))
            for name, reason in zip(
                cast("list[str]", lost["fullname"].to_pylist()),
                pc.fill_null(lost["gone"], "missing").to_pylist(),
                strict=True,
            ):
                found.setdefault(name, reason)
        # A post that was purged before may have got comments since.
        posts = {
            name[3:]
            for name in found.keys() | tombstones.keys(run.root, "reddit")
            if name.startswith("t3_")
        }
        below = pa.array(sorted(posts), pa.string())
        for rows in things:
            theirs = pc.and_(
                pc.starts_with(rows["fullname"], "t1_"), pc.is_in(rows["post_id"], value_set=below)
            )
            for name in cast("list[str]", rows["fullname"].filter(theirs).to_pylist()):
                found.setdefault(name, "post")
    return found


def purge_raw(run: Run, ids: Path | None) -> dict[str, str]:
    """Tombstones, raw segments, frontier, and what crossposts show; the keys that must leave
    everything else as well.

    Raises SettingError when `ids` can't be read, before anything is written; Interrupted (the same
    command goes on).
    """
    said = {}
    if ids and (bad_lines := read_wanted(ids, run.progress.say).bad_lines):
        said["bad_lines"] = bad_lines
    # What a killed import had not noted holds texts too. Damage is set aside and told later.
    with open_session(run, RedditSource(run), asks=False, tells=False) as session:
        keys = collected(session, lambda: PurgeKeys(collect(run, ids), said))
        purge.begin(run.root, "reddit", keys)
        if keys:
            _take_out(run, session.frontier, keys)
    return keys


def _take_out(run: Run, frontier: Frontier, keys: dict[str, str]) -> None:
    """Keys leave raw answers, the state, and what crossposts show."""
    mending.drop_asides(run.root, "reddit", frontier, keys, ())
    crossposts = _rewrite(run, frontier)
    for base in BASES:
        drop_parents(run.root / base / "posts", crossposts, keys)
    _forget(frontier, keys)
    # Answers of a reconstruction that was cut off; it asks again.
    for base in REBUILT:
        for work in (run.root / base).glob(".work-*"):
            shutil.rmtree(work)


def _rewrite(run: Run, frontier: Frontier) -> set[str]:
    """The raw segments again, without the keys that are noted; the bare ids of crossposts of them.

    Raises Interrupted.
    """
    paths = rawlog.all_segments(run.root, "reddit")
    # Processes of their own take a second to start.
    workers = run.workers if sum(path.stat().st_size for path in paths) > _MUCH else 1
    engine = run.engine if workers > 1 else "local"
    crossposts: set[str] = set()
    with make_executor(engine, workers, run.scheduler) as executor:
        tasks = ((str(run.root), str(path)) for path in purge.in_hand(frontier, paths))
        made = map_in_order(executor, rewrite, tasks, window=2 * workers)
        for path, shown in zip(paths, made, strict=True):
            purge.done(frontier, path)
            crossposts.update(shown)
    return crossposts


def rewrite(root: str, segment: str) -> list[str]:
    """One segment without the noted keys; the crossposts of them in it. Runs in a worker."""
    noted = Layout(Path(root)).purge("reddit").stat()
    keys, holds = _noted(root, noted.st_mtime_ns, noted.st_ino)
    crossposts: set[str] = set()
    purge.replace(Path(segment), _stripped(Path(segment), keys, holds, crossposts))
    return sorted(crossposts)


def _stripped(
    path: Path, keys: Collection[str], holds: Holds, crossposts: set[str]
) -> Iterator[tuple[int, int, Envelope | None]]:
    """The frames of a segment that hold keys, and what is left of each envelope.

    `crossposts` collects the bare ids of posts that repeat a key, also those that an interrupted
    purge has already stripped.
    """
    frames = rawlog.Frames(path, checked=True)
    for end, line in frames:
        if holds(line):
            envelope = rawlog.decode(line)
            crossposts |= crossposts_of(envelope.response, keys)
            left = strip(path.parent.name, envelope, keys)
            if left is not envelope:
                yield frames.start, end, left


@lru_cache(maxsize=1)
def _noted(root: str, changed: int, inode: int) -> tuple[Collection[str], Holds]:
    """The keys of the list as it is now, and a test for bytes that may hold one.

    With many keys most answers hold one, so every answer is decoded.
    """
    keys = frozenset(purge.left_over(Path(root), "reddit"))
    return keys, holding(keys) if len(keys) < _MANY else everything(keys)


def holding(keys: Collection[str]) -> Holds:
    """A thing's own record has its id without the kind."""
    return finder(map(tree.bare, keys), alone=True)


def mend(root: Path, keys: Collection[str]) -> None:
    """What rows say of other rows, after those of `keys` went: counts, missing parents, parts that
    failed.
    """
    for path in sorted(Layout(root).clean("reddit", "failed").glob("*.parquet")):
        with reading([path]):
            rows = parquet.read_table(path)
        held = cast("list[str]", rows["key"].to_pylist())
        left = [key.partition("/")[0] not in keys for key in held]
        if not all(left):
            write_table(path, rows.filter(pa.array(left, pa.bool_())), "shared/failed")
    for base in BASES:
        threads.count_again(root / base)


def _forget(frontier: Frontier, names: Collection[str]) -> None:
    for kind, prefix in (("tree", "t3_"), ("more", "t1_"), (INFO.kind, "")):
        frontier.remove(kind, [key.removeprefix(prefix) for key in names if key.startswith(prefix)])
    threads = [
        key
        for key, *_ in frontier.items("thread")
        if f"t3_{key.partition('/')[0]}" in names or f"t1_{key.partition('/')[2]}" in names
    ]
    frontier.remove("thread", threads)
    for key, _, _, payload in frontier.items("listing"):
        # Its next page stood behind a post that goes: read from the first page again.
        if payload is not None and payload.after in names:
            start = msgspec.structs.replace(payload, after=None, pages=0)
            frontier.payload("listing", key, start)
