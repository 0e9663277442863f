"""Helpers of all export formats: sorted rows of a table, and JSON lists with an item a line."""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from kb.artifacts.table_catalog import Catalog
from kb.artifacts.texts import exported_files
from kb.core.errors import FatalError
from kb.schema.tables import table
from kb.store.artifact_registry import of_table
from kb.store.atomic import writing
from kb.store.tables.merge import Merge
from kb.store.tables.shard_writer import order

Row = dict[str, Any]


def sorted_rows(
    root: Path, name: str, columns: Sequence[str], by: Sequence[str] = ()
) -> Iterator[Row]:
    """Rows of a declared table, in its own order or `by` columns, a piece at a time in memory."""
    parts = exported_files(Catalog(root.absolute()), name)
    if not parts:
        return
    with contextlib.closing(Merge(parts, list(by) or order(table(name)), list(columns))) as merge:
        for piece in merge:
            yield from piece.to_pylist()


def check_rows(root: Path, name: str) -> None:
    """Raises FatalError when a table has no rows to export."""
    if not exported_files(Catalog(root.absolute()), name):
        raise FatalError(
            f"nothing to export: {root} has no content of {name}",
            hint=f"run `{of_table(name).command}` first",
        )


@contextlib.contextmanager
def json_list(path: Path) -> Iterator[Callable[[Any], None]]:
    """A JSON list in ASCII that appears at `path` when the block ends well; the function adds an
    item. Raises DiskFull.
    """
    with writing(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write("[")
        comma = "\n"

        def add_item(item: Any) -> None:
            nonlocal comma
            file.write(comma + json.dumps(item))
            comma = ",\n"

        yield add_item
        file.write("\n]\n")
