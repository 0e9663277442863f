"""The local engine: results in the order of the tasks, and no worker that outlives its parent."""

from __future__ import annotations

import os
import subprocess
import sys

import psutil
import pytest

from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError

PROGRAM = """
import os, time
from kb.core.engine import make_executor
if __name__ == "__main__":
    with make_executor("local", 2) as pool:
        print(*{pool.submit(os.getpid).result() for _ in range(8)}, flush=True)
        time.sleep(60)
"""


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
