"""Runs a query in a process of its own, which can't exceed its limits: for untrusted clients.

The process has no environment and may not write files; it is killed if it does not end in time.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

import kb
from kb.artifacts.table_catalog import View
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.query.execute import select
from kb.query.formats import as_csv
from kb.query.limits import Limits, limited, restrict_process, timed_out
from kb.query.views import connect

_START = 20.0  # seconds that the process may need besides its query
_KINDS: dict[str, type[KbError]] = {
    kind.__name__: kind for kind in (UsageError, FatalError, DamagedData)
}
# The package may be imported from a folder that only this process knows.
_CODE = "import sys; sys.path.append(sys.argv[1]); from kb.query.isolated import main; main()"


class IsolatedQuery(msgspec.Struct):
    """What the process reads on stdin."""

    sql: str
    views: list[tuple[str, str, list[Path]]]  # schema, name, files
    rows: int
    characters: int
    cell: int
    seconds: float
    memory: int
    parent: int


class QueryReply(msgspec.Struct):
    """What the process writes: lines of CSV, the header first, and whether there are more; or an
    error (`kind` is its class).
    """

    lines: list[str] = []
    more: bool = False
    error: str = ""
    hint: str = ""
    kind: str = ""


def run_isolated(
    sql: str, views: Sequence[View], *, rows: int, characters: int, cell: int, limits: Limits
) -> QueryReply:
    """At most `rows` rows of a query over these views (with absolute paths), as lines of CSV.

    The lines have at most `characters` characters together, and a value at most `cell`. Raises
    UsageError, DamagedData or FatalError as `select` does, and FatalError for a query that exceeds
    its limits.
    """
    query = IsolatedQuery(
        sql,
        [(one.schema, one.name, one.files) for one in views],
        rows,
        characters,
        cell,
        limits.seconds,
        limits.memory,
        os.getpid(),
    )
    home = str(Path(kb.__file__).resolve().parent.parent)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _CODE, home],
            input=msgspec.json.encode(query, enc_hook=str),
            capture_output=True,
            timeout=limits.seconds + _START,
            env={"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"},
            cwd="/",
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise timed_out(limits.seconds) from None
    if done.returncode == 1 and b"longer than" in done.stderr:
        raise timed_out(limits.seconds)
    try:
        reply = msgspec.json.decode(done.stdout, type=QueryReply)
    except msgspec.DecodeError:
        raise FatalError(
            f"the query's process ended with exit code {done.returncode}: it exceeded its memory"
            " or other limits",
            hint="ask for less at a time",
        ) from None
    if reply.kind:
        raise _KINDS.get(reply.kind, FatalError)(reply.error, hint=reply.hint)
    return reply


def main() -> None:
    """Read a query, run it, write the reply; the process ends here."""
    query = msgspec.json.decode(
        sys.stdin.buffer.read(), type=IsolatedQuery, dec_hook=lambda _, path: Path(path)
    )
    tempfile.tempdir = os.devnull  # nothing is spilled
    limits = Limits(query.seconds, query.memory, threads=2)
    restrict_process(limits, query.parent)
    sys.stdout.buffer.write(msgspec.json.encode(_reply(query, limits)))
    sys.stdout.buffer.flush()
    os._exit(0)  # without waiting for threads of an interrupted query


def _reply(query: IsolatedQuery, limits: Limits) -> QueryReply:
    try:
        views = [View(schema, name, files, "") for schema, name, files in query.views]
        with contextlib.closing(connect(None, views, limits)) as con, limited(con, limits):
            reader = select(con, query.sql, views=views, text=True)
            lines = as_csv(reader, query.cell)
            return QueryReply(*_first(lines, query.rows + 1, query.characters))
    except KbError as error:
        kind = next(one.__name__ for one in type(error).__mro__ if one.__module__.startswith("kb."))
        return QueryReply(error=str(error), hint=error.hint, kind=kind)
    except MemoryError:
        return QueryReply(error="the query needs too much memory", kind=FatalError.__name__)


def _first(lines: Iterator[str], count: int, characters: int) -> tuple[list[str], bool]:
    """The first lines, and whether there are more."""
    taken: list[str] = []
    room = characters
    for line in lines:
        if len(taken) == count or len(line) > room:
            return taken, True
        taken.append(line)
        room -= len(line)
    return taken, False
