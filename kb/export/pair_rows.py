"""Pairs in the order of videos and clips, for the layouts made of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.schema.tables import table
from kb.store.layout import Layout
from kb.store.merge import Merge
from kb.store.shards import order


def pair_rows(run: Run, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Rows of pairs/ one by one, sorted by video and clip.

    Raises FatalError when there is no index.
    """
    declared = table("pairs/pairs")
    parts = manifest.rows(run.root, declared.name)
    if not parts:
        raise FatalError(
            f"nothing to export: {Layout(run.root).pairs} has no index", hint="run `kb pairs` first"
        )
    merge = Merge(parts, order(declared), list(columns))
    try:
        for rows in merge:
            yield from rows.to_pylist()
    finally:
        merge.close()
