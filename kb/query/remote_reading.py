"""What went wrong while DuckDB read files at addresses, as `kb.query.remote_duckdb` lets it."""

import contextlib
import re
from collections.abc import Iterable, Iterator

import duckdb
import pyarrow as pa

from kb.artifacts.table_catalog import View
from kb.store.damage import unreadable

SCHEME = "address"


@contextlib.contextmanager
def reading_views(views: Iterable[View]) -> Iterator[None]:
    """Raises what went wrong with a file at an address, of which DuckDB keeps the text only."""
    folders = [view.remote.folder for view in views if view.remote is not None]
    for folder in folders:
        folder.failures.clear()
    try:
        yield
    except (duckdb.Error, pa.ArrowException, OSError) as error:
        line = str(error).partition("\n")[0]
        named = re.search(rf"{SCHEME}://\d+/([^'\"\s]+)", line)
        for folder in folders:
            if folder.failures:
                raise folder.failures[0] from None
            if named and named[1] in folder.sizes:
                what = line.replace(named[0], named[1])
                raise unreadable(f"{folder}/{named[1]}", what, "publish it again") from None
        raise
