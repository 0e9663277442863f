"""Reads and writes pairs/measures.json: one section for each measure, each with its sample size.

The sections hold figures alone, no ids and no text. They stay when pairs are made again by the
same rules, and go when the rules (keywords, section, seed) have changed.
"""

import shutil
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts import manifest
from kb.core.errors import FatalError
from kb.store.atomic import write_bytes
from kb.store.layout import Layout
from kb.store.lock import writer
from kb.store.state import json_files

FILE = "measures.json"


def read_measures(folder: Path) -> dict[str, Any]:
    """The sections in a folder of pairs by name; {} where nothing was measured.

    Raises DamagedData.
    """
    fix = "remove it, then run `kb pairs measure` again"
    found: dict[str, Any] | None = json_files.read(folder / FILE, dict[str, Any], fix=fix)
    return found or {}


def write_measure(root: Path, name: str, section: dict[str, Any]) -> Path:
    """Set one section; the others stay. Returns the file.

    Raises FatalError without pairs, WriterLocked, DamagedData, DiskFull.
    """
    folder = Layout(root).pairs
    with writer(root, "pairs"):
        check_pairs(root)
        sections = read_measures(folder) | {name: section}
        ordered = {one: sections[one] for one in sorted(sections)}
        with manifest.editing(root, "pairs"):
            encoded = msgspec.json.format(msgspec.json.encode(ordered), indent=1)
            write_bytes(folder / FILE, encoded + b"\n")
    return folder / FILE


def check_pairs(root: Path) -> None:
    """Raises FatalError where no pairs were made."""
    if manifest.read(root, "pairs") is None:
        raise FatalError("there are no pairs", hint="run `kb pairs` first")


def keep_measures(old: Path, new: Path) -> None:
    """Copy the measures into the folder that takes the place of `old`."""
    if (old / FILE).is_file():
        shutil.copyfile(old / FILE, new / FILE)
