"""SHA-256 of files: computing it, where it is recorded, and comparing the two.

    clean/wiki/_manifest.json            the files of an artifact (kb.artifacts.manifest)
    state/manifests/release-wiki.json    the same for folders that are given away as they are
    release/wiki/SHA256SUMS              their public form, as `sha256sum -c` reads it

Readers of a file call `check` first: it compares the bytes with what is recorded, once in a
process. Files without a record are read as they are.

A release may come with links, by mistake or by malice, and a cache of downloads (Hugging Face's
snapshots, git-annex) has nothing else. A link may lead to any file of this machine, so it is read
only where the checksums describe the very bytes: they are compared through one descriptor, which
everything is read from then on, wherever the link leads later. A list of checksums can't describe
itself; nothing of it but digests and names is used.
"""

import contextlib
import hashlib
import os
import re
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

import msgspec

from kb.core.errors import DamagedData
from kb.core.regular_file import NotRegular, check_regular, open_regular, read_regular
from kb.store.artifact_registry import SUMS, artifact_of
from kb.store.damage import SMALL, open_file, opening, unreadable

MISMATCH = "checksum mismatch"
LINE = 1_000_000  # bytes of a line of JSON
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
# Descriptors of links' files. They stay open as long as the process: a library may open them anew
# at any time, and the number of another file must never be one of these.
_pinned: dict[_Stamp, int] = {}


def digest(path: Path, algorithm: str = "sha256", advance: Advance | None = None) -> str:
    """Hexadecimal digest of a file; `advance` is called with the number of bytes read. Raises
    OSError.
    """
    with open_regular(path) as file:
        return _digest_of(file, algorithm, advance)


def _digest_of(file: BinaryIO, algorithm: str = "sha256", advance: Advance | None = None) -> str:
    computed = hashlib.new(algorithm)
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


def verify_recorded(
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
        if entry is not None and path.is_symlink():
            _pin(path, entry, advance)
        elif entry is not None and digest(path, advance=advance) != entry.sha256:
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


def library_path(path: Path | str) -> str:
    """The path by which a library such as DuckDB or Arrow may open a file: its own, or that of a
    verified descriptor for a link of which the checksum is recorded. Raises DamagedData, also for
    what is no regular file.
    """
    with opening(path), open_file(Path(path)):  # a library would wait for a pipe
        pass
    if not Path(path).is_symlink() or (entry := recorded(Path(path))) is None:
        return str(path)
    return f"/dev/fd/{_pin(Path(path), entry)}"


def _pin(path: Path, entry: FileEntry, advance: Advance | None = None) -> int:
    """A descriptor of the file that a link leads to, whose bytes are those that are recorded.
    Raises DamagedData.
    """
    with open_file(path) as file:
        stamp = _stamp(str(path), os.fstat(file.fileno()))
        if stamp not in _pinned:
            if _digest_of(file, advance=advance) != entry.sha256:
                raise unreadable(path, MISMATCH)
            _pinned[stamp] = os.dup(file.fileno())
            _verified.add(stamp)
    return _pinned[stamp]


@contextlib.contextmanager
def opened(path: Path, hint: str = "") -> Iterator[BinaryIO]:
    """A file of a stranger's folder to read. Raises DamagedData, also for a link unless a checksum
    describes the very bytes.
    """
    with opening(path, hint=hint), open_file(path, hint) as file:
        about = os.fstat(file.fileno())
        if not os.path.samestat(about, path.lstat()):
            entry = recorded(path)
            if entry is None:
                raise unreadable(path, f"it is a link, and {SUMS} does not describe it", hint)
            if _digest_of(file) != entry.sha256:
                raise unreadable(path, MISMATCH, hint)
            file.seek(0)
        yield file


def short_lines(path: Path, hint: str = "") -> Iterator[bytes]:
    """The lines of a file of a stranger's folder, of at most LINE bytes each. Raises DamagedData,
    also as `opened`.
    """
    with opened(path, hint) as file:
        while line := file.readline(LINE + 1):
            if len(line) > LINE:
                raise unreadable(path, f"a line has more than {LINE:,} bytes", hint)
            yield line


def read_small(path: Path, hint: str = "") -> bytes:
    """A file of a stranger's folder as a whole, of at most SMALL bytes. Raises DamagedData, also as
    `opened`.
    """
    if _size_of(path) > SMALL:  # before the bytes behind a link are compared
        raise unreadable(path, f"it has more than {SMALL:,} bytes", hint)
    with opened(path, hint) as file:
        return _at_most(file, path, hint)


def read_sums(path: Path, hint: str = "") -> tuple[dict[str, str], int]:
    """(file name → digest, number of invalid lines) of a SHA256SUMS, which may be a link. Raises
    DamagedData.
    """
    with opening(path, UnicodeDecodeError, hint=hint), open_file(path, hint) as file:
        return parsed(_at_most(file, path, hint).decode())


def _size_of(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0  # who opens it says so


def _at_most(file: BinaryIO, path: Path, hint: str) -> bytes:
    data = file.read(SMALL + 1)
    if len(data) > SMALL:
        raise unreadable(path, f"it has more than {SMALL:,} bytes", hint)
    return data


def unverified_size(paths: Iterable[Path | str]) -> int:
    """How many bytes `check` would read."""
    return sum(size for _, size, *_ in _unverified(paths))


def _unverified(paths: Iterable[Path | str]) -> list[_Stamp]:
    stamps = []
    for path in dict.fromkeys(map(str, paths)):
        try:
            stamps.append(_stamp(path, check_regular(path)))
        except NotRegular as error:
            raise unreadable(path, error) from None
    return [stamp for stamp in stamps if stamp not in _verified]


def _stamp(path: str, about: os.stat_result) -> _Stamp:
    return path, about.st_size, about.st_ino, about.st_mtime_ns


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
            lines = read_sums(place)[0]
            return {name: FileEntry(sha256=value) for name, value in lines.items()}
        return msgspec.json.decode(read_regular(place), type=_Files).files
    except (OSError, DamagedData, msgspec.DecodeError, RecursionError):
        return {}  # whoever reads the manifest itself says so
