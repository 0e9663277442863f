"""SHA256SUMS: written for `sha256sum -c`, and read back by the gate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kb.release.folders import Folder, is_made
from kb.release.problem import Problem, damaged
from kb.store.atomic import write_text
from kb.store.digests import SUMS, digest, listed, parsed


def write(folder: Folder) -> Path:
    """Write SHA256SUMS over every file of the folder, by name."""
    path = folder.path / SUMS
    write_text(path, listed(folder.files()))
    return path


def read(folder: Path) -> dict[str, str]:
    """File name → digest as SHA256SUMS says; empty when there is none.

    Raises ValueError when it is damaged.
    """
    path = folder / SUMS
    if not path.is_file():
        return {}
    sums, bad_lines = parsed(path.read_text(encoding="utf-8"))
    if bad_lines:
        raise ValueError("a line is no checksum and name")
    return sums


def check(folder: Folder, files: Sequence[Path], *, all_listed: bool = False) -> list[Problem]:
    """A line for each file that differs from SHA256SUMS or is gone; `all_listed`: also for files it
    does not know.

    Without `all_listed` what `kb release` makes may be gone: it is made again.
    """
    try:
        sums = read(folder.path)
    except (OSError, ValueError) as error:
        return [
            damaged(
                f"{folder.source}/{SUMS}",
                error,
                "what was exported can't be compared with it: export it again",
            )
        ]
    problems = []
    for file in files:
        where = f"{folder.source}/{file.name}"
        if file.name not in sums:
            if all_listed and sums:
                problems.append(Problem("checksum", where, f"is not in {SUMS}; run `kb release`"))
        elif digest(file) != sums[file.name]:
            problems.append(Problem("checksum", where, f"differs from {SUMS}; export it again"))
    gone = [
        name
        for name in sums
        if not (folder.path / name).exists() and (all_listed or not is_made(name, folder.source))
    ]
    return problems + [
        Problem(
            "checksum", f"{folder.source}/{name}", f"is in {SUMS} but not there; export it again"
        )
        for name in gone
    ]
