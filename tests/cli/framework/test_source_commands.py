"""Tests of `filter` and `export`, which every source has."""

from pathlib import Path

import pytest

from kb.core.sources import SOURCES, SPECS
from tests.inprocess import Here


@pytest.mark.parametrize("source", SOURCES)
def test_formats_are_those_of_the_source(here: Here, tmp_path: Path, source: str) -> None:
    (tmp_path / "data").mkdir()
    at = ("--data", str(tmp_path / "data"))
    done = here(source, "export", "--format", "nonesuch", *at)
    assert done.code == 2
    assert all(name in done.said for name in SPECS[source].formats), done.said


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("step", ["filter", "export"])
def test_without_data_nothing_is_written(
    here: Here, tmp_path: Path, source: str, step: str
) -> None:
    root = tmp_path / "data"
    root.mkdir()
    assert here(source, step, "--data", str(root)).code in (1, 2)
    assert not [path for path in root.rglob("*") if path.is_file() and path.suffix == ".parquet"]
