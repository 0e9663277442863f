"""Opens files that users name, or that lie in folders that users name: regular files alone.

A FIFO would block for ever, and a device such as /dev/zero has no end. So a file is opened without
waiting and looked at before anything is read of it. What is no regular file is an OSError like any
other file that can't be read, and callers treat it as such.
"""

import errno
import os
import stat
from io import DEFAULT_BUFFER_SIZE, BufferedReader, FileIO
from pathlib import Path

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class NotRegular(OSError):
    """A path that is no regular file where one is needed; `strerror` says what it is."""


def open_regular(
    path: Path | str, *, links: bool = True, buffering: int = DEFAULT_BUFFER_SIZE
) -> BufferedReader:
    """A regular file, or with `links` a link to one, to read; `buffering` in bytes.

    Raises NotRegular for anything else that is there, OSError where nothing is.
    """
    if links:  # without them, the file may be replaced by a link between the two steps
        check_regular(path)  # a socket can't be opened, and opening a device may do something
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if links else os.O_NOFOLLOW)
    descriptor = os.open(path, flags)
    try:
        _refuse_other(path, os.fstat(descriptor).st_mode)
        os.set_blocking(descriptor, True)
        return BufferedReader(FileIO(descriptor, "rb"), buffering)
    except BaseException:
        os.close(descriptor)
        raise


def check_regular(path: Path | str) -> os.stat_result:
    """What `os.stat` says of a regular file or a link to one: call it before a library opens a
    path itself. Raises NotRegular for anything else, OSError where nothing is.
    """
    about = os.stat(path)  # noqa: PTH116  of many files
    _refuse_other(path, about.st_mode)
    return about


def read_regular(path: Path | str, most: int | None = None) -> bytes:
    """The bytes of a regular file. Raises as `open_regular`, and OSError beyond `most` bytes."""
    with open_regular(path) as file:
        data = file.read() if most is None else file.read(most + 1)
    if most is not None and len(data) > most:
        # Not EFBIG: with that, writing a file fails where the disk or a limit ends.
        raise OSError(errno.EOVERFLOW, f"it has more than {most:,} bytes", str(path))
    return data


def _refuse_other(path: Path | str, mode: int) -> None:
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "no regular file")
        raise NotRegular(errno.EINVAL, f"it is {kind}, not a file", str(path))
