"""Raw to release at a share of the paper's size, as a table with floors and what it makes at 100 %.

SHARE=0.05 make bench ARGS="-k raw_to_release"                       a share of your own
SHARE=0.05 AGAINST=before.json make bench ARGS="-k raw_to_release"   beside figures kept before
SHARE=0.05 KEEP=before.json CODE=../older make bench ARGS="…"        an older checkout's code
"""

import json
import os
from pathlib import Path

import pytest

from tests.bench import scale

pytestmark = [pytest.mark.bench, pytest.mark.timeout(6 * 3600)]

SHARE = float(os.environ.get("SHARE", "0.003"))
MEMORY = 3 << 10  # MiB


def _bytes(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*.parquet"))
    }


def test_a_cluster_on_this_machine(tmp_path: Path) -> None:
    """The largest stage on local Dask workers: the same bytes, and the rate beside one worker's.

    What a cluster and its workers cost before they see data is measured and taken off.
    """
    pytest.importorskip("distributed")
    stage = next(one for one in scale.STAGES if one.name == "youtube filter")
    seconds: dict[int, float] = {}
    made: dict[int, dict[str, bytes]] = {}
    for workers in (1, 2, 4):
        walls = []
        for share in (scale.BASE, SHARE):
            bench = scale.Bench(tmp_path, scale.HERE, share, workers)
            bench.prepare(fresh=False)
            words = (*stage.words, "--engine", "dask")
            walls.append(bench.run(stage._replace(words=words)).wall)
            made[workers] = _bytes(bench.root / "clean")
        seconds[workers] = max(0.01, walls[1] - walls[0])
    print(f"\nDask, share {SHARE:g}, {os.cpu_count()} cores: seconds without the start")
    for workers, took in seconds.items():
        print(f"  {workers} workers {took:8.1f} s, {seconds[1] / took:.2f} x one")
    assert made[1] == made[2] == made[4]
    assert made[1]


def test_raw_to_release(tmp_path: Path) -> None:
    kept = os.environ.get("AGAINST")
    code = Path(os.environ.get("CODE", scale.HERE)).resolve()
    keep = Path(os.environ["KEEP"]).resolve() if "KEEP" in os.environ else None
    made = scale.figures(tmp_path, code, SHARE, os.cpu_count() or 1, [], keep)
    print("\n" + scale.table(made, json.loads(Path(kept).read_text()) if kept else None))
    assert max(found["peak"] for found in made["stages"].values()) < MEMORY
