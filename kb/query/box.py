"""An answer on a terminal: DuckDB's own box, fitted to its width."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from itertools import islice
from typing import Any

import pyarrow as pa
from pyarrow import types

from kb.core import terminal
from kb.query.statements import distinct
from kb.query.text import TABLE_ROWS, is_number, more, people, rows
from kb.store import database


def as_box(answer: pa.RecordBatchReader, width: int) -> Iterator[str]:
    """The box of the first hundred rows, `width` columns wide at most, and how many there are.

    DuckDB makes none narrower than 80. Columns that find no room are left out and counted by
    DuckDB under the box.
    """
    stream = rows(answer)
    shown = list(islice(stream, TABLE_ROWS))
    total = len(shown) + sum(1 for _ in stream)
    names = distinct([terminal.one_line(name) for name in answer.schema.names])
    columns = [[row[at] for row in shown] for at in range(len(names))]
    table = pa.table(
        [_column(values, field.type) for values, field in zip(columns, answer.schema, strict=True)],
        names=names,
    )
    printed = io.StringIO()
    with database.connect() as con, contextlib.redirect_stdout(printed):
        # Without max_rows DuckDB leaves out the middle of what is longer than twenty rows.
        con.from_arrow(table).show(max_width=width, max_rows=TABLE_ROWS)
    yield printed.getvalue().rstrip() + "\n"
    if total > len(shown):
        yield more(total)


def _column(values: list[Any], kind: pa.DataType) -> pa.Array[Any]:
    """Numbers and truth values as they are, so that they stand on the right; all else as text."""
    if types.is_float32(kind):
        return pa.array(values, pa.float64())
    if is_number(kind) or types.is_boolean(kind):
        return pa.array(values, kind)
    return pa.array([None if value is None else people(value) for value in values], pa.string())
