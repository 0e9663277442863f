"""What of Reddit's data must go: what its author deleted, moderators removed, the service no longer has, or a person named.

Keys are full names. The comments of a purged post go with it, from raw and from every table (reason `post`):
their addresses hold its title. Replies to a purged comment stay.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path

from kb.core.context import Run
from kb.reddit.reconstruction import OUT
from kb.reddit.refresh import KIND as INFO
from kb.reddit.refresh import newest
from kb.reddit.state import apply
from kb.reddit.strip import strip
from kb.reddit.wanted import read_wanted
from kb.store import lock, purge, tombstones
from kb.store.frontier import Frontier
from kb.store.purge import Place
from kb.store.recorder import Recorder

ROWS = (
    *(place for base in ("clean/reddit", str(OUT)) for place in (
        Place(f"{base}/posts", "reddit/posts", "post_id", "t3_"),
        Place(f"{base}/comments", "reddit/comments", "comment_id", "t1_"),
        Place(f"{base}/comments", "reddit/comments", "post_id", "t3_"),
    )),
    Place(str(OUT), "reddit/missing", "key"),
    *(Place(f"clean/reddit/{verdict}", f"shared/{verdict}", "key") for verdict in ("rejected", "failed", "pending")),
)


def collect(run: Run, ids: Path | None) -> dict[str, str]:
    """What is to go and why: `deleted`, `removed`, `missing`, `named`, and `post` for comments of posts that go."""
    found: dict[str, str] = {}
    if ids:
        wanted = read_wanted(ids)
        found = dict.fromkeys([*wanted.names, *(f"t3_{key}" for key in wanted.trees)], "named")
    known = newest(run.root, run.profile.section("reddit").links)
    for name, row in known.items():
        if not row.there or row.gone:
            found.setdefault(name, row.gone or "missing")
    # A post that was purged before may have got comments since.
    posts = found.keys() | tombstones.keys(run.root, "reddit")
    for name, row in known.items():
        if name.startswith("t1_") and f"t3_{row.post}" in posts:
            found.setdefault(name, "post")
    return found


def purge_raw(run: Run, ids: Path | None) -> dict[str, str]:
    """Tombstones, raw segments and frontier; the keys that must leave everything else as well.

    Raises SettingError when `ids` can't be read, before anything is written.
    """
    if ids:
        read_wanted(ids)
    with lock.writer(run.root, "reddit"):
        frontier = Frontier(run.root / "state" / "reddit.sqlite")
        try:
            # Opening the recorder cuts torn frames, closes segments and takes in what was not read yet.
            Recorder(run.root, "reddit", frontier, apply).close()
            keys = purge.begin(run.root, "reddit", collect(run, ids))
            if keys:
                purge.rewrite_raw(run.root, "reddit", keys.keys(), strip, frontier)
                _forget(frontier, keys)
                # Answers of a reconstruction that was cut off; it asks again.
                for work in (run.root / OUT).glob(".work-*"):
                    shutil.rmtree(work)
        finally:
            frontier.close()
    return keys


def _forget(frontier: Frontier, names: Collection[str]) -> None:
    for kind, prefix in (("tree", "t3_"), ("more", "t1_"), (INFO, "")):
        frontier.remove(kind, [key.removeprefix(prefix) for key in names if key.startswith(prefix)])
    threads = [key for key, *_ in frontier.items("thread")
               if f"t3_{key.partition('/')[0]}" in names or f"t1_{key.partition('/')[2]}" in names]
    frontier.remove("thread", threads)
