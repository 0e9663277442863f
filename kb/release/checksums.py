"""SHA256SUMS: written for `sha256sum -c`, and read back by the gate."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from kb.release.folders import SUMS, Folder
from kb.release.problem import Problem
from kb.store.atomic import write_text


def digest(path: Path, algorithm: str = "sha256") -> str:
    """Hexadecimal digest of a file, read in pieces."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, algorithm).hexdigest()


def write(folder: Folder) -> Path:
    """Write SHA256SUMS over every file of the folder, by name."""
    path = folder.path / SUMS
    write_text(path, "".join(f"{digest(file)}  {file.name}\n" for file in folder.files()))
    return path


def read(folder: Path) -> dict[str, str]:
    """File name → digest as SHA256SUMS says; empty when there is none."""
    path = folder / SUMS
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {name: value for value, _, name in (line.partition("  ") for line in lines) if name}


def check(folder: Folder, files: Sequence[Path], *, all_listed: bool = False) -> list[Problem]:
    """A line for each file that differs from SHA256SUMS; `all_listed`: also for files it does not know."""
    sums = read(folder.path)
    found = []
    for file in files:
        where = f"{folder.source}/{file.name}"
        if file.name not in sums:
            if all_listed and sums:
                found.append(Problem("checksum", where, f"is not in {SUMS}; run `kb release`"))
        elif digest(file) != sums[file.name]:
            found.append(Problem("checksum", where, f"differs from {SUMS}; export it again"))
    if all_listed:
        found += [Problem("checksum", f"{folder.source}/{name}", f"is in {SUMS} but not there") for name in sums if not (folder.path / name).exists()]
    return found
