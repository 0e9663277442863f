"""Opens files that users name: regular files alone.

A FIFO would block for ever, and a device such as /dev/zero has no end. So a file is opened without
waiting and looked at before anything is read of it.
"""

import os
import stat
from io import BufferedReader
from pathlib import Path

from kb.core.errors import FatalError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class NotRegular(FatalError):
    """A path that is no regular file where one is needed."""


def open_regular(path: Path) -> BufferedReader:
    """A regular file, or a link to one, open for reading.

    Raises NotRegular for anything else that is there, OSError where nothing is.
    """
    check_regular(path)  # a socket can't be opened, and opening a device may do something
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _refuse_other(path, os.fstat(descriptor).st_mode)
        os.set_blocking(descriptor, True)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def check_regular(path: Path) -> None:
    """Raises NotRegular unless the path is a regular file or a link to one, OSError where nothing
    is. For libraries that open paths themselves.
    """
    _refuse_other(path, path.stat().st_mode)


def _refuse_other(path: Path, mode: int) -> None:
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "no regular file")
        raise NotRegular(f"{path} is {kind}", hint="name a regular file")
