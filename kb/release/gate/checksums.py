"""SHA256SUMS: written for `sha256sum -c`, and compared by the gate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kb.artifacts import release_folder
from kb.artifacts.release_folder import ReleaseFolder
from kb.release.folders import is_made
from kb.release.gate.problem import GateProblem
from kb.store.atomic import write_text
from kb.store.checksums import SUMS, digest, listed


def write(folder: ReleaseFolder) -> Path:
    """Write SHA256SUMS over every file of the folder, by name."""
    path = folder.path / SUMS
    write_text(path, listed(folder.files()))
    return path


def check(
    folder: ReleaseFolder, files: Sequence[Path], *, all_listed: bool = False
) -> list[GateProblem]:
    """A line for each file that differs from SHA256SUMS or is gone; `all_listed`: also for files it
    does not know.

    Without `all_listed` what `kb release` makes may be gone: it is made again.
    """
    sums, invalid = release_folder.sums(folder.path)
    if invalid:
        return [
            GateProblem(
                "damaged",
                f"{folder.source}/{SUMS}",
                "can't be read as a list of checksums to compare the export with; export it again",
            )
        ]
    problems = []
    for file in files:
        where = f"{folder.source}/{file.name}"
        if file.name not in sums:
            if all_listed and sums:
                problems.append(
                    GateProblem("checksum", where, f"is not in {SUMS}; run `kb release`")
                )
        elif digest(file) != sums[file.name]:
            problems.append(GateProblem("checksum", where, f"differs from {SUMS}; export it again"))
    gone = [
        name
        for name in sums
        if not (folder.path / name).exists() and (all_listed or not is_made(name, folder.source))
    ]
    return problems + [
        GateProblem(
            "checksum", f"{folder.source}/{name}", f"is in {SUMS} but not there; export it again"
        )
        for name in gone
    ]
