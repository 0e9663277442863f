"""Reads text that people write: profiles and keyword lists, those of a stranger's release too."""

import errno
import os
import stat
from pathlib import Path

_MOST = 10_000_000  # bytes


def read_text(path: Path) -> str:
    """The text without an editor's mark at its beginning. A pipe or a device is not waited for, and
    at most 10 MB are read. Raises OSError, UnicodeDecodeError.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "it is no file but a pipe, a device or a folder", str(path))
        data = file.read(_MOST + 1)
    if len(data) > _MOST:
        raise OSError(errno.EINVAL, f"it has more than {_MOST:,} bytes", str(path))
    return data.decode("utf-8-sig")
