"""The local engine: results in the order of the tasks, and no worker that outlives its parent."""

import multiprocessing
import os
import subprocess
import sys

import psutil
import pytest

from kb.core import engine
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError
from kb.store.rawlog.recorder import Recorder
from kb.store.state.frontier import Frontier

PROGRAM = """
import os, time
from kb.core import engine
from kb.core.engine import make_executor
if __name__ == "__main__":
    with make_executor("local", 2) as pool:
        print(*{pool.submit(os.getpid).result() for _ in range(8)}, flush=True)
        time.sleep(60)
"""


LOADED = """
import sys
from pathlib import Path
from kb.core.context import Run
from kb.core.engine import make_executor
from kb.core.config.profile import load_profile
from kb.core.config.settings import Settings
from kb.filters import filter_run, tasks

HEAVY = ("pandas", "torch", "transformers", "onnxruntime", "selenium", "PIL", "matplotlib", "dask")

def heavy(*task):
    tasks.decode_segment(*task)
    import pyarrow
    assert pyarrow.array([None, 1.5]).null_count == 1
    return [name for name in HEAVY if name in sys.modules]

if __name__ == "__main__":
    root = Path(sys.argv[1])
    run = Run(settings=Settings(), profile=load_profile("minecraft"), root=root)
    job = filter_run._job(run, "youtube")._replace(work=str(root / "work"), buckets=2)
    segment = next((root / "raw" / "youtube" / "videos").iterdir())
    for workers in (1, 2):
        with make_executor("local", workers) as pool:
            print(pool.submit(heavy, job, "videos", str(segment), 0).result(), flush=True)
    import pandas, pyarrow
    print(pyarrow.table({"a": [1]}).to_pandas()["a"].tolist())
"""


def test_a_worker_of_a_filter_loads_neither_pandas_nor_any_model(tmp_path):
    pytest.importorskip("pandas")
    program = tmp_path / "program.py"
    program.write_text(LOADED)
    with Recorder(tmp_path, "youtube", Frontier(tmp_path / "state.sqlite"), never) as recorder:
        item = {"id": "a", "snippet": {"title": "t", "tags": ["x"]}}
        recorder.record("videos", "videos.list", {"id": "a,b"}, 200, {"items": [item]})
    done = subprocess.run(
        [sys.executable, str(program), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == ["[]", "[]", "[1]"], done.stderr


def never(*_):
    """Nothing is known of the answer's keys."""


@pytest.fixture(autouse=True)
def _as_shipped(monkeypatch):
    """Other tests fork their pools (tests/conftest.py); these are started as a user's are."""
    monkeypatch.setattr(engine, "multiprocessing", multiprocessing)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_tasks(workers):
    with make_executor("local", workers) as pool:
        assert list(map_in_order(pool, pow, ((n, 2) for n in range(9)), window=3)) == [
            n * n for n in range(9)
        ]


def test_no_more_tasks_are_taken_than_the_window():
    taken = []

    def tasks():
        for number in range(9):
            taken.append(number)
            yield (number,)

    with make_executor("local", 1) as pool:
        results = map_in_order(pool, abs, tasks(), window=2)
        next(results)
        assert taken == [0, 1]


def test_workers_of_a_killed_parent_end(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "program.py")],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    workers = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
    assert workers
    parent.kill()
    parent.wait()
    _gone, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive


def test_a_worker_that_was_killed_is_told_and_not_unexpected():
    with (
        pytest.raises(FatalError, match="a worker process was killed") as error,
        make_executor("local", 2) as pool,
    ):
        list(map_in_order(pool, os._exit, [(1,)]))
    assert "--workers" in error.value.hint
