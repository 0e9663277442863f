"""Tasks that workers import by name."""

import os
import signal
import time
from pathlib import Path

from kb.core.errors import SettingError
from kb.store.exhausted import full_disk_is_resumable


def square(number: int) -> int:
    return number * number


def now_there() -> str | None:
    return os.environ.get("KB_NOW")


def fails() -> None:
    raise SettingError("not so", hint="but so")


def die_once(folder: str, number: int) -> int:
    """The first worker that takes number 3 dies of it."""
    mark = Path(folder, "died")
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def linger(folder: str) -> None:
    """Works for longer than any test; the mark says that it began."""
    Path(folder, "begun").touch()
    time.sleep(600)


def linger_once(folder: str) -> str:
    """The first call works for longer than any test."""
    if not Path(folder, "begun").exists():
        linger(folder)
    return "done"


def pid_of(number: int) -> int:
    """Who did it."""
    return os.getpid()


def fill_up(path: str) -> None:
    """Writes where there is no room."""
    with full_disk_is_resumable(Path(path)), Path(path).open("wb") as file:
        file.write(b"x" * (1 << 20))


def take_memory() -> int:
    """Takes more than any machine has."""
    return len(bytearray(1 << 60))
