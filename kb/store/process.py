"""Marks temporary files with their process, and tells whether that process still runs."""

import re
from pathlib import Path

_MARK = re.compile(r"(\d+)-(\d+)")


def mark() -> str:
    """This process for good: its number, and when it began, as numbers are given again."""
    stat = _stat("self")
    return f"{stat[0]}-{stat[1]}" if stat is not None else "0-0"


def has_ended(text: str) -> bool:
    """Whether the process that a mark within `text` names has ended; False without a mark."""
    match = _MARK.search(text)
    if match is None or match[1] == "0":
        return False
    stat = _stat(match[1])
    return stat is None or stat[1] != int(match[2])


def _stat(process: str) -> tuple[int, int] | None:
    """Number and start (ticks since the machine was booted) of a process of this machine."""
    try:
        text = Path("/proc", process, "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The second field is a name in brackets, which may hold anything; the start is the 22nd.
    fields = text.rpartition(")")[2].split()
    return int(text.split(" ", 1)[0]), int(fields[19])
