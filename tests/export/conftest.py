"""A data root with clean rows, and a run at it."""

from pathlib import Path

import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import Settings
from kb.core.context import Run
from kb.schema import table
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table


@pytest.fixture
def run_at():
    """run_at(root): a run of the shipped profile at that data root."""
    return _run_at


@pytest.fixture
def fill():
    """fill(root, table, rows, parts): the rows spread over so many clean part files."""
    return _fill


def _run_at(root: Path) -> Run:
    return Run(settings=Settings(), profile=load_profile("minecraft"), root=root)


def _fill(root: Path, name: str, rows: pa.Table, parts: int) -> None:
    declared = table(name)
    for index in range(parts):
        part = rows.take(list(range(index, rows.num_rows, parts)))
        write_table(Layout(root).table(name) / f"part-{index:05d}.parquet", part, declared)
