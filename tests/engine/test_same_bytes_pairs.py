"""Pairs of a two-worker cluster are the bytes of the local engine, also when a worker is killed."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.pairs import build as building
from tests.conftest import needs
from tests.pairs.made import fill, tables

needs("distributed")


pytestmark = pytest.mark.dask


@pytest.fixture(scope="module")
def data():
    return tables(80, 400, ["creeper", "oak log", "iron golem"], share=0.06)


def pairs(root: Path, data, make_rows, **options) -> dict[str, bytes]:
    fill(root, *data, make_rows)
    summary = building.build(
        Run(load_settings(dotenv=False), load_profile("minecraft"), root, **options)
    )
    assert summary["videos"] == 80
    assert summary["pairs"] > 100
    return {path.name: path.read_bytes() for path in (root / "pairs").iterdir()}


def test_the_same_bytes(
    cluster, kill_a_worker, tmp_path: Path, data, make_rows, monkeypatch
) -> None:
    local = pairs(tmp_path / "local", data, make_rows, workers=1)
    monkeypatch.setattr(building, "_ROWS", 5)
    kill_a_worker(lambda: any((tmp_path / "dask/state").glob("pairs/*/*.parquet")))
    spread = pairs(
        tmp_path / "dask",
        data,
        make_rows,
        workers=2,
        engine="dask",
        scheduler=cluster.scheduler_address,
    )
    assert {name: data for name, data in spread.items() if name.endswith(".parquet")} == {
        name: data for name, data in local.items() if name.endswith(".parquet")
    }
