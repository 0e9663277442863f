"""SHA-256 of files: computing it, where it is recorded, and comparing the two.

    clean/wiki/_manifest.json            the files of an artifact (kb.artifacts.manifest)
    state/manifests/release-wiki.json    the same for folders that are given away as they are
    release/wiki/SHA256SUMS              their public form, as `sha256sum -c` reads it

Readers of a file call `check` first: it compares the bytes with what is recorded, once in a
process. Files without a record are read as they are.
"""

import hashlib
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import msgspec

from kb.core.errors import DamagedData
from kb.core.regular_file import NotRegular, check_regular, open_regular, read_regular
from kb.store.artifact_registry import SUMS, artifact_of
from kb.store.damage import read_small, unreadable

MISMATCH = "checksum mismatch"
_LINE = re.compile(r"([0-9a-f]{64})  ([^/]+)")
_CHUNK = 1 << 20
_LARGE = 1 << 20  # bytes of files that are worth several threads
_THREADS = 4

Advance = Callable[[int], None]


class FileEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """A file of an artifact. `sha256` is "" where it is not known; `rows` is for tables."""

    size: int = 0
    sha256: str = ""
    rows: int | None = None


class _Files(msgspec.Struct):
    """The part of a manifest that this module reads."""

    files: dict[str, FileEntry] = {}


# A file as it is now, (path, size, inode, time of change): another one differs in one of these.
_Stamp = tuple[str, int, int, int]
_verified: set[_Stamp] = set()  # files that this process has read in full


def digest(path: Path, algorithm: str = "sha256", advance: Advance | None = None) -> str:
    """Hexadecimal digest of a file; `advance` is called with the number of bytes read. Raises
    OSError.
    """
    computed = hashlib.new(algorithm)
    with open_regular(path) as file:
        while chunk := file.read(_CHUNK):
            computed.update(chunk)
            if advance is not None:
                advance(len(chunk))
    return computed.hexdigest()


def listed(files: Iterable[Path]) -> str:
    """A line for each file: its digest and its name."""
    return "".join(f"{digest(file)}  {file.name}\n" for file in files)


def parsed(text: str) -> tuple[dict[str, str], int]:
    """(file name → digest, number of invalid lines)."""
    lines = text.splitlines()
    matches = [match for line in lines if (match := _LINE.fullmatch(line))]
    return {match[2]: match[1] for match in matches}, len(lines) - len(matches)


def recorded(path: Path) -> FileEntry | None:
    """The entry of a file in a manifest or a SHA256SUMS; None where neither has its digest."""
    places = [(path.parent / SUMS, path.name)]
    if match := artifact_of(path):
        root, artifact = match
        name = path.relative_to(artifact.folder(root)).as_posix()
        places.insert(0, (artifact.manifest(root), name))
    for place, name in places:
        entry = _entries(place).get(name)
        if entry is not None and entry.sha256:
            return entry
    return None


def check(
    *paths: Path | str,
    advance: Advance | None = None,
    unrecorded: Callable[[Path], object] | None = None,
) -> None:
    """Raises DamagedData for the first file whose bytes are not those that are recorded of it.

    `advance` is called with the number of bytes read, `unrecorded` with files of which nothing is.
    """
    fresh = _unverified(paths)

    def verify(stamp: _Stamp) -> None:
        path = Path(stamp[0])
        entry = recorded(path)
        if entry is not None and digest(path, advance=advance) != entry.sha256:
            raise unreadable(path, MISMATCH)
        if entry is None and unrecorded is not None:
            unrecorded(path)
        if entry is not None or unrecorded is not None:
            _verified.add(stamp)

    if len(fresh) > 1 and sum(size for _, size, *_ in fresh) > _LARGE:
        with ThreadPoolExecutor(min(_THREADS, len(fresh))) as pool:
            list(pool.map(verify, fresh))
    else:
        for stamp in fresh:
            verify(stamp)


def unverified_size(paths: Iterable[Path | str]) -> int:
    """How many bytes `check` would read."""
    return sum(size for _, size, *_ in _unverified(paths))


def _unverified(paths: Iterable[Path | str]) -> list[_Stamp]:
    stamps = []
    for path in dict.fromkeys(map(str, paths)):
        try:
            about = check_regular(path)
        except NotRegular as error:
            raise unreadable(path, error) from None
        stamps.append((path, about.st_size, about.st_ino, about.st_mtime_ns))
    return [stamp for stamp in stamps if stamp not in _verified]


def _entries(place: Path) -> dict[str, FileEntry]:
    try:
        about = check_regular(place)
    except OSError:
        return {}
    return _read_entries(place, about.st_ino, about.st_size, about.st_mtime_ns)


@lru_cache(maxsize=64)
def _read_entries(place: Path, *_stamp: int) -> dict[str, FileEntry]:
    """The entries of a file of digests; cached, as it is asked for each of the files."""
    try:
        if place.name == SUMS:
            lines = parsed(read_small(place).decode())[0]
            return {name: FileEntry(sha256=value) for name, value in lines.items()}
        return msgspec.json.decode(read_regular(place), type=_Files).files
    except (OSError, DamagedData, UnicodeDecodeError, msgspec.DecodeError, RecursionError):
        return {}  # whoever reads the manifest itself says so
