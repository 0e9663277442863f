"""The process of `kb.query.guarded`: one query from stdin, its first rows to stdout."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec

from kb.core.errors import FatalError, KbError
from kb.query.bounds import Limits, bounded, strict
from kb.query.execute import select
from kb.query.guarded import Asked, QueryReply
from kb.query.text import csv_lines
from kb.query.views import connect


def main() -> None:
    """Read, run, answer; the process ends here."""
    asked = msgspec.json.decode(
        sys.stdin.buffer.read(), type=Asked, dec_hook=lambda _, path: Path(path)
    )
    tempfile.tempdir = os.devnull  # nothing is spilled
    limits = Limits(asked.seconds, asked.memory, threads=2)
    strict(limits, asked.parent)
    sys.stdout.buffer.write(msgspec.json.encode(_answer(asked, limits)))
    sys.stdout.buffer.flush()
    os._exit(0)  # threads of a query that was interrupted need not be waited for


def _answer(asked: Asked, limits: Limits) -> QueryReply:
    try:
        with contextlib.closing(connect(None, asked.views, limits)) as con, bounded(con, limits):
            reader = select(con, asked.sql, views=asked.views, text=True)
            lines = csv_lines(reader, asked.cell)
            return QueryReply(*_first(lines, asked.rows + 1, asked.characters))
    except KbError as error:
        kind = next(one.__name__ for one in type(error).__mro__ if one.__module__.startswith("kb."))
        return QueryReply(error=str(error), hint=error.hint, kind=kind)
    except MemoryError:
        return QueryReply(error="the query needs too much memory", kind=FatalError.__name__)


def _first(lines: Iterator[str], count: int, characters: int) -> tuple[list[str], bool]:
    """The first lines, and whether there are more than these."""
    taken: list[str] = []
    room = characters
    for line in lines:
        if len(taken) == count or len(line) > room:
            return taken, True
        taken.append(line)
        room -= len(line)
    return taken, False
