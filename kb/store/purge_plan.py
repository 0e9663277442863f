"""What a purge would remove, counted by table and folder. Sends nothing, changes nothing."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pyarrow.compute as pc

from kb.core.verdict import Summary
from kb.store import parquet, purge, rawlog
from kb.store.frontier import Frontier
from kb.store.layout import BELOW, Layout
from kb.store.purge import RowLocation, Strip
from kb.store.purge_search import Found, Holds, everything, search
from kb.store.reading import reading


class PlanLine(msgspec.Struct):
    """A line of the plan: a folder under the data root, what it has of the keys, and how many."""

    folder: str
    what: str
    count: int


@contextmanager
def state(
    root: Path, source: str, payloads: Mapping[str, type[msgspec.Struct]] | None = None
) -> Iterator[Frontier | None]:
    """A copy of the source's state to read, as opening it in place would leave files;
    None without one.
    """
    first = Layout(root).state(source)
    files = [path for path in (first, first.with_name(f"{first.name}-wal")) if path.is_file()]
    if not files:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="lorecrawl-plan-") as scratch:
        for file in files:
            shutil.copyfile(file, Path(scratch, file.name))
        frontier = Frontier(Path(scratch, files[0].name), readonly=True, payloads=payloads)
        try:
            yield frontier
        finally:
            frontier.close()


def plan(
    root: Path,
    source: str,
    found: dict[str, str],
    strip: Strip,
    places: Iterable[RowLocation],
    holding: Callable[[Collection[str]], Holds] = everything,
) -> Summary:
    """Counts of what would go for `found` (key to reason) and what an unfinished purge has left.

    `lines` has what each folder loses: raw answers that are changed or removed, rows, and files
    that are made again. `holding` makes of keys what tells whether an answer may hold one. Raises
    DamagedData.
    """
    keys = purge.left_over(root, source) | found
    lines = [*_raw(root, source, keys, strip, search(root, source, holding(keys)))]
    seen = set()
    for place in (*places, *_released(places)) if keys else ():
        if place not in seen:
            lines.append(PlanLine(place.folder, place.table, _rows(root, place, keys)))
            seen.add(place)
    lines = [line for line in lines if line.count]
    lines += _made(root, source) if keys else []

    def total(what: str) -> int:
        return sum(line.count for line in lines if line.folder.split("/")[0] == what)

    return Summary(
        source=source,
        purged=sum(reason != "post" for reason in keys.values()),
        answers=total("raw"),
        rows=total("clean"),
        pairs=total("pairs"),
        links=total("links"),
        released=total("release"),
        lines=[msgspec.to_builtins(line) for line in lines],
    )


def _raw(
    root: Path, source: str, keys: Collection[str], strip: Strip, found: Found
) -> Iterator[PlanLine]:
    for kind in rawlog.kinds(root, source):
        changed = sum(
            1
            for path, places in found.items()
            if path.parent.name == kind
            for _ in purge.stripped(path, places, keys, strip)
        )
        yield PlanLine(str(BELOW.raw(source, kind)), "answers", changed)


def _released(places: Iterable[RowLocation]) -> Iterator[RowLocation]:
    """The same tables in release/, whose folders are flat."""
    for place in places:
        source = place.table.partition("/")[0]
        if place.folder == str(BELOW.table(place.table)):
            yield place._replace(folder=str(BELOW.release(source)))


def _rows(root: Path, place: RowLocation, keys: Collection[str]) -> int:
    wanted = place.values(keys)
    name = place.table.partition("/")[2]
    flat = Path(place.folder).is_relative_to(BELOW.release())
    pattern = f"{name}-*.parquet" if flat else place.pattern
    count = 0
    for path in sorted((root / place.folder).glob(pattern)):
        with reading([path]), parquet.open_file(path) as file:
            for rows in file.iter_batches(columns=place.reads):
                count += pc.sum(place.holds(rows, wanted)).as_py() or 0
    return count


def _made(root: Path, source: str) -> Iterator[PlanLine]:
    """What has to be written anew as a whole."""
    index = Layout(root).index(source)
    if files := sum(path.is_file() for path in index.rglob("*")):
        below = str(BELOW.index(source))
        yield PlanLine(below, "files, made again by the next search", files)
    for folder in (Layout(root).export(), Layout(root).report):
        files = sum(path.is_file() for path in folder.rglob("*"))
        if files:
            yield PlanLine(
                folder.name, "files, made again as far as they are of this source", files
            )
