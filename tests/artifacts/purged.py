"""What a purge says of a list of ids, and that its plan says the same and writes nothing."""

from pathlib import Path

from kb.core.config.pipeline import Recipe
from kb.core.context import Run

COUNTS = ("purged", "also", "known", "unknown", "unread")


def purged(run: Run, source: str, *lines: str) -> tuple[int, ...]:
    """`COUNTS` of a purge of these lines, after a plan of the same."""
    ids = run.root.with_name("purged.txt")
    ids.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    room, before = Recipe("purge"), _files(run.root)
    planned = room.defined("plan")(run, source, ids)
    assert _files(run.root) == before
    done = room.defined("purge")(run, source, ids)
    assert [planned[name] for name in COUNTS] == [done[name] for name in COUNTS]
    return tuple(done[name] for name in COUNTS)


def _files(root: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
