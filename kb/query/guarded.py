"""A query in a process of its own, for those whom nobody trusts: it can't take more than it may.

`kb.query.child` runs it, without the environment of this process, with no right to write a file of
any size; it is killed where it does not end.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

import kb
from kb.artifacts.catalog import View
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.query.bounds import Limits, too_long

_START = 20.0  # seconds that a process may take beside its query
_KINDS: dict[str, type[KbError]] = {
    kind.__name__: kind for kind in (UsageError, FatalError, DamagedData)
}


class Asked(msgspec.Struct):
    """What the other process is told."""

    sql: str
    views: list[View]
    rows: int
    characters: int
    cell: int
    seconds: float
    memory: int
    parent: int


class QueryReply(msgspec.Struct):
    """What it answers: lines of CSV, the head first, and whether there are more; or what was wrong
    (`kind` is the error's class).
    """

    lines: list[str] = []
    more: bool = False
    error: str = ""
    hint: str = ""
    kind: str = ""


def ask(
    sql: str, views: Sequence[View], *, rows: int, characters: int, cell: int, limits: Limits
) -> QueryReply:
    """At most `rows` rows of a query over these views (with absolute paths), as lines of CSV.

    They have at most so many characters together, and a value not more than `cell`. Raises
    UsageError, DamagedData or FatalError as `select` does, and FatalError for a query that takes
    more time or memory than it may.
    """
    asked = Asked(
        sql, list(views), rows, characters, cell, limits.seconds, limits.memory, os.getpid()
    )
    home = str(Path(kb.__file__).resolve().parent.parent)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _CODE, home],
            input=msgspec.json.encode(asked, enc_hook=str),
            capture_output=True,
            timeout=limits.seconds + _START,
            env={"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"},
            cwd="/",
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise too_long(limits.seconds) from None
    if done.returncode == 1 and b"longer than" in done.stderr:
        raise too_long(limits.seconds)
    try:
        told = msgspec.json.decode(done.stdout, type=QueryReply)
    except msgspec.DecodeError:
        raise FatalError(
            f"the query's process ended with {done.returncode}: it needs too much memory, or more"
            " than it may do",
            hint="ask for less at a time",
        ) from None
    if told.kind:
        raise _KINDS.get(told.kind, FatalError)(told.error, hint=told.hint)
    return told


# The package may be imported from a folder that only this process knows of.
_CODE = "import sys; sys.path.append(sys.argv[1]); from kb.query.child import main; main()"
