"""SHA-256 of files, and the list of them that `sha256sum -c` reads."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from pathlib import Path

SUMS = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64})  ([^/]+)")
_CHUNK = 1 << 20


def digest(
    path: Path, algorithm: str = "sha256", advance: Callable[[int], None] | None = None
) -> str:
    """Hexadecimal digest of a file, read in pieces; `advance` hears how many bytes were read."""
    computed = hashlib.new(algorithm)
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            computed.update(chunk)
            if advance is not None:
                advance(len(chunk))
    return computed.hexdigest()


def listed(files: Iterable[Path]) -> str:
    """A line for each file: its digest and its name."""
    return "".join(f"{digest(file)}  {file.name}\n" for file in files)


def parsed(text: str) -> tuple[dict[str, str], int]:
    """(file name → digest, how many lines are neither)."""
    lines = text.splitlines()
    matches = [match for line in lines if (match := _LINE.fullmatch(line))]
    return {match[2]: match[1] for match in matches}, len(lines) - len(matches)
