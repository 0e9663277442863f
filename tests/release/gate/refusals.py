"""What the gate says of a release, and changes to its tables."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import ReleaseRefused
from tests.recipes import release
from tests.release.conftest import a_run

Rows = list[dict[str, Any]]


def refused(root: Path, **options: Any) -> list[str]:
    """The gate's lines."""
    with pytest.raises(ReleaseRefused) as caught:
        release(a_run(root, **options))
    return caught.value.problems


def changed(
    name: str, change: Callable[[dict[str, Any]], object], rows: slice = slice(0, 1)
) -> Callable[[str, Rows], None]:
    """An edit of made rows."""

    def edit(table: str, made: Rows) -> None:
        for row in made[rows] if table == name else []:
            change(row)

    return edit


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(change(pq.read_table(path)), path)


def with_first(rows: pa.Table, column: str, value: object) -> pa.Table:
    """The rows with another value of `column` in the first one."""
    index = rows.column_names.index(column)
    return rows.set_column(
        index,
        rows.schema.field(index).with_nullable(True),
        pa.array([value, *rows[column].to_pylist()[1:]], rows.schema.field(index).type),
    )
