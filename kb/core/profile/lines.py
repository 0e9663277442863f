"""On which line of a TOML text a key stands; tomllib itself does not say."""

from __future__ import annotations

import re
from collections import Counter

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_NAME = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_NAME})\s*\]")
_KEY = re.compile(rf"\s*({_NAME})\s*=")


def key_lines(text: str) -> dict[str, int]:
    """Full name of every key and table to its line, counted from 1; entries of lists from [1]."""
    lines: dict[str, int] = {}
    table, tables = "", Counter[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _plain(header[2])
            lines.setdefault(table, number)
            if header[1] == "[[":
                tables[table] += 1
                table = f"{table}[{tables[table]}]"
                lines.setdefault(table, number)
        elif key := _KEY.match(line):
            name = _plain(key[1])
            lines.setdefault(f"{table}.{name}" if table else name, number)
    return lines


def line_of(lines: dict[str, int], key: str) -> int:
    """The line of a key, else of the list or table that it stands in, else 0."""
    while key:
        if key in lines:
            return lines[key]
        inside = [line for name, line in lines.items() if name.startswith(f"{key}.")]
        if inside:  # a table that is written by dotted keys alone
            return min(inside)
        key = key.rpartition("[")[0] if key.endswith("]") else key.rpartition(".")[0]
    return 0


def _plain(name: str) -> str:
    return ".".join(part.strip("\"'") for part in re.findall(_PART, name))
