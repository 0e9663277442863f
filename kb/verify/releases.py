"""Checks a release folder against its SHA256SUMS, its metadata and the names of its shards."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kb.artifacts import manifest, release_folder
from kb.core.errors import DamagedData
from kb.store.artifact_registry import SUMS
from kb.store.damage import read_small, short_lines
from kb.store.tables import checksums
from kb.verify.files import problem
from kb.verify.findings import Findings

CROISSANT = "croissant.json"
_PLAIN = {".gitkeep"}


def folder(
    findings: Findings, path: Path, advice: Callable[[Path], str], *, described: bool
) -> None:
    """Every file of a release folder; `described`: it should have SHA256SUMS."""
    sums = path / SUMS
    known, invalid = release_folder.sums(path)
    if sums.is_file() and (not known or invalid):
        findings.damaged("release", sums, "is not a list of checksums", advice(sums))
    elif sums.is_file():
        findings.intact("release", sums)
    elif described:
        findings.missing("release", sums, advice(sums))
    there = {file.name: file for file in sorted(path.iterdir())}
    for name, file in there.items():
        if file == sums or name in _PLAIN:
            continue
        if file.is_symlink() or not file.is_file():
            findings.foreign(
                "release", file, "a release is flat, with files of its own", "move it away"
            )
        elif known and name not in known:
            findings.foreign("release", file, f"is not in {SUMS}", "move it away")
        else:
            _file(findings, file, known.get(name), advice(file))
    for name in sorted((known.keys() | manifest.siblings(there)) - there.keys()):
        findings.missing("release", path / name, advice(path / name))
    if known:
        _metadata(findings, path / CROISSANT, known, advice)


def _file(findings: Findings, path: Path, wanted: str | None, advice: str) -> None:
    if wanted is not None:
        actual = checksums.digest(path, advance=findings.advance)
        what = "" if actual == wanted else f"differs from {SUMS}"
    elif path.suffix == ".parquet":
        what = problem(path, findings.advance)
    elif path.suffix == ".tar":
        findings.advance(path.stat().st_size)
        what = _tar(path)
    else:
        findings.advance(path.stat().st_size)
        what = ""
    findings.checked("release", path, what, advice)


def _tar(path: Path) -> str:
    """What is wrong with a tar by the index beside it, "" when nothing is."""
    index = path.parent / release_folder.INDEX
    if not index.is_file():
        return ""
    left = path.stat().st_size  # the members lie side by side, so together they are no larger
    try:
        with path.open("rb") as tar:
            for line in short_lines(index):
                entry = json.loads(line)
                if entry["tar"] != path.name:
                    continue
                offset, size = int(entry["offset"]), int(entry["size"])
                left -= size
                if size < 0 or left < 0 or not _holds(tar, offset, size, entry["sha256"]):
                    return f"{entry['member']} in it is not what {release_folder.INDEX} says"
    except (DamagedData, ValueError, KeyError, TypeError, OverflowError, RecursionError, OSError):
        return f"{release_folder.INDEX} beside it can't be read"
    return ""


def _holds(tar: Any, offset: int, size: int, wanted: str) -> bool:
    computed = hashlib.sha256()
    tar.seek(offset)
    while size and (chunk := tar.read(min(size, 1 << 20))):
        computed.update(chunk)
        size -= len(chunk)
    return not size and computed.hexdigest() == wanted


def _metadata(
    findings: Findings, path: Path, known: dict[str, str], advice: Callable[[Path], str]
) -> None:
    """Croissant names files with their digests: the same as SHA256SUMS."""
    if not path.is_file():
        return
    try:
        digests = {
            one["contentUrl"].rpartition("/")[2]: one["sha256"]
            for one in json.loads(read_small(path))["distribution"]
            if "sha256" in one
        }
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, DamagedData):
        digests = None
    if digests is None:
        findings.damaged("release", path, "is not valid metadata", advice(path))
        return
    for name, value in sorted(digests.items()):
        if known.get(name, value) != value:
            what = f"has another digest of {name} than {SUMS}"
            findings.damaged("release", path, what, advice(path))
