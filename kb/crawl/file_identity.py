"""Tells a file that was read before from any other, without reading it.

What a file is, its content says: names, sizes and times are those of other files as well. But to
read hundreds of gigabytes again, only to find that nothing is new, would take hours. So what was
read is noted under a stamp of path, size, inode and both times. Nobody sets the time of change
(ctime) by hand: whatever replaces the content of the file renews it, also where size and time of
modification stay. An equal stamp therefore means the same content; another one means nothing, and
the content has to be looked at.
"""

import hashlib
import os
from io import BufferedReader, RawIOBase
from typing import Any


def file_stamp(path: str | os.PathLike[str], about: os.stat_result, use: str = "") -> bytes:
    """12 bytes that stand for a file as it is now; `use` tells apart what it was read for."""
    place = os.fsencode(os.path.abspath(path))  # noqa: PTH100  of many files, links as they are
    numbers = (about.st_size, about.st_ino, about.st_mtime_ns, about.st_ctime_ns)
    text = "\0".join([use, *map(str, numbers)]).encode() + b"\0" + place
    return hashlib.blake2b(text, digest_size=12).digest()


class Hashed(RawIOBase):
    """A file whose SHA-256 is computed while it is read, so that a large one is read once."""

    def __init__(self, file: BufferedReader) -> None:
        self._file, self._digest = file, hashlib.sha256()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        size = self._file.readinto(buffer)
        self._digest.update(memoryview(buffer)[:size])
        return size

    @property
    def sha256(self) -> str:
        """The digest of all that was read."""
        return self._digest.hexdigest()
