"""What can be mended without making anything again: copies, and names that no reader takes.

Foreign files are never touched, and nothing is deleted: what is damaged gets the ending
`.damaged`, or is noted for the next crawl.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from kb.core.errors import KbError
from kb.store import digests, parquet, sidefiles
from kb.store.atomic import write_bytes
from kb.store.layout import Layout, parquet_files
from kb.verify.found import Found, Look

Step = Callable[[], object]


def set_aside(root: Path, look: Look) -> list[str]:
    """Lines of what was done. Call it under all locks. Raises DiskFull."""
    said = [_tombstones(root, one) for one in look.of("tombstones", state="damaged")]
    for one in look.of("annotations", state="damaged"):
        sidefiles.set_aside(one.path)
        said.append(f"{one.path} was set aside; the filter scores again what it held")
    for one in look.of("state", state="damaged"):
        if one.path.suffix == ".sqlite":
            for ending in ("-wal", "-shm"):
                one.path.with_name(one.path.name + ending).unlink(missing_ok=True)
            sidefiles.set_aside(one.path)
            said.append(f"{one.path} was set aside; it is built again from the raw data")
    lost = [one.path for one in look.of("captures", "images") if one.state != "foreign"]
    if lost:
        sidefiles.suspect(root, "wiki", lost)
        said.append(f"{len(lost):,} captured files are noted for `kb wiki crawl`")
    return said


def fetched_by(root: Path, look: Look, source: str) -> bool:
    """Whether something is lost that a crawl of the source asks for again."""
    at = Layout(root)
    places = (at.raw(source), at.state(source))
    return any(
        one.state != "foreign" and any(one.path.is_relative_to(place) for place in places)
        for one in look.of("raw answers", "captures", "images", "state")
    )


def made_again(look: Look, kind: str, folder: Path) -> bool:
    """Whether a folder of tables has to be made again."""
    return any(one.state != "foreign" and one.path.is_relative_to(folder) for one in look.of(kind))


def in_the_way(look: Look, folder: Path) -> Found | None:
    """A foreign file that would go with a folder that is made again."""
    foreign = [one for one in look.found if one.state == "foreign" and one.kind != "leftovers"]
    return next((one for one in foreign if one.path.is_relative_to(folder)), None)


def make(look: Look, command: str, folder: Path, step: Step) -> list[str]:
    """Make a folder again, unless a file of somebody else's would go with it."""
    foreign = in_the_way(look, folder)
    if foreign is not None:
        return [f"{folder} was left: move {foreign.path} away, then run `{command}`"]
    return tried(command, step)


def tried(command: str, step: Step) -> list[str]:
    """What a command does, or why it could not."""
    try:
        step()
    except KbError as error:
        way = f"; {error.hint}" if error.hint else ""
        return [f"`{command}` has to be run: {error}{way}"]
    return [f"`{command}` was run"]


def undescribed(at: Layout, source: str) -> bool:
    """Whether a folder that was described once has tables and no checksums.

    It was made again, by this repair or by one that was killed before it came to the description.
    """
    folder = at.release(source)
    described = at.released(source).is_dir() and any(at.released(source).iterdir())
    return described and bool(parquet_files(folder)) and not (folder / digests.SUMS).exists()


def _tombstones(root: Path, one: Found) -> str:
    source = one.path.parent.name
    for other in Layout(root).tombstones(source):
        # A copy that is as whole takes its place; of two damaged ones none is right.
        if other != one.path and other.is_file() and other.stat().st_size and _holds(other):
            write_bytes(one.path, other.read_bytes())
            return f"{one.path} is its copy {other} again"
    return f"{one.path} could not be mended: no copy of it is whole; put it back from a copy"


def _holds(path: Path) -> bool:
    return parquet.has_checksum(path) and parquet.holds(path)
