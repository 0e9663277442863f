"""Bytes for people."""

from __future__ import annotations

_UNITS = (("TB", 10**12), ("GB", 10**9), ("MB", 10**6), ("kB", 10**3))


def shown(n: int, digits: int = 1) -> str:
    """1,234,567 as "1.2 MB"."""
    for unit, step in _UNITS:
        if n >= step:
            return f"{n / step:.{digits}f} {unit}"
    return f"{n} B"
