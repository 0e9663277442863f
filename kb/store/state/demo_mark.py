"""The mark of a demo's data root, whose data are all invented.

demo.json lies beside the folders, so that it stays while a demo that starts over removes them.
"""

from pathlib import Path

import msgspec

from kb.store.atomic import write_bytes
from kb.store.damage import read_note

NAME = "demo.json"
NOTE = (
    "All data here are invented: kb demo made them on this machine. Their ids, names and links"
    " lead to nothing real."
)


class DemoMark(msgspec.Struct, frozen=True):
    """`finished`: every step was done, so that the next demo starts over."""

    finished: bool


def read_mark(root: Path) -> DemoMark | None:
    """The mark; None where no demo made the data root. Raises DamagedData."""
    fix = "delete the demo's folder and run `kb demo` again"
    return read_note(root / NAME, DemoMark, fix=fix)


def write_mark(root: Path, *, finished: bool) -> None:
    """Mark a data root. Raises DiskFull."""
    write_bytes(root / NAME, msgspec.json.encode(DemoMark(finished)) + b"\n")


def note(root: Path) -> list[str]:
    """What each page about a data root has to say of it: that its data are invented."""
    return [NOTE] if read_mark(root) is not None else []
