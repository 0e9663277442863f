"""The Dask engine behind the executor seam: order, errors, dying workers,
and what a user can set wrong.
"""

import contextlib
import socket
import sys
from pathlib import Path

import psutil
import pytest

from kb.core import dask_engine
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError, MissingExtra, SettingError, Unreachable

sys.path.insert(0, str(Path(__file__).parent))
import tasks

from tests.conftest import needs

needs("distributed")


pytestmark = pytest.mark.dask


@pytest.fixture(scope="module")
def pool(cluster):
    import distributed

    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        client.run(sys.path.insert, 0, str(Path(__file__).parent))
    with make_executor("dask", 2, cluster.scheduler_address) as executor:
        yield executor


def test_results_come_in_the_order_of_the_tasks(pool):
    assert list(map_in_order(pool, tasks.square, ((n,) for n in range(40)))) == [
        n * n for n in range(40)
    ]


def test_a_projects_error_arrives_as_it_was_raised(pool):
    with pytest.raises(SettingError, match="not so") as error:
        list(map_in_order(pool, tasks.fails, [()]))
    assert error.value.hint == "but so"


def test_workers_have_this_process_date(pool, cluster, monkeypatch):
    monkeypatch.setenv("KB_NOW", "2026-01-02T03:04:05Z")
    with make_executor("dask", 2, cluster.scheduler_address) as executor:
        assert executor.submit(tasks.now_there).result() == "2026-01-02T03:04:05Z"


def test_a_task_of_a_dead_worker_is_run_again(pool, tmp_path):
    numbers = [(str(tmp_path), n) for n in range(12)]
    assert list(map_in_order(pool, tasks.die_once, numbers, window=4)) == list(range(12))
    assert (tmp_path / "died").exists()


def test_a_task_that_kills_every_worker_ends_the_run(pool):
    with pytest.raises(FatalError, match="died on the same task"):
        pool.submit(tasks.die).result()


def test_a_wrong_address_is_exit_2_and_a_silent_one_exit_3(monkeypatch):
    with pytest.raises(SettingError), make_executor("dask", 1, "not an address"):
        pass
    monkeypatch.setattr(dask_engine, "CONNECT_S", 1.0)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with (
            pytest.raises(Unreachable) as error,
            make_executor("dask", 1, f"tcp://127.0.0.1:{nobody.getsockname()[1]}"),
        ):
            pass
    assert error.value.exit_code == 3


def test_without_the_extra_it_is_exit_2(monkeypatch):
    monkeypatch.setattr(dask_engine.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra) as error:
        dask_engine.check("tcp://127.0.0.1:1")
    assert "[dask]" in error.value.hint


def test_without_an_address_it_brings_its_own_cluster():
    before = listening()
    with make_executor("dask", 1, None) as executor:
        assert executor.submit(len, "abc").result() == 3
        opened = listening() - before
    assert len(opened) >= 3, "scheduler, nanny and worker listen"
    # Whoever reaches them can run code: no other machine does.
    assert {address for _, address, _ in opened} == {"127.0.0.1"}


def listening() -> set[tuple[int, str, int]]:
    """(process, address, port) of every socket that this process or one below it listens on."""
    this = psutil.Process()
    found = set()
    for process in [this, *this.children(recursive=True)]:
        with contextlib.suppress(psutil.NoSuchProcess):
            for held in process.net_connections("inet"):
                if held.status == psutil.CONN_LISTEN:
                    found.add((process.pid, held.laddr.ip, held.laddr.port))
    return found


def test_other_versions_on_the_workers_are_refused(cluster, monkeypatch):
    monkeypatch.setattr(dask_engine, "__version__", "9.9")
    with (
        pytest.raises(FatalError, match=r"9\.9"),
        make_executor("dask", 1, cluster.scheduler_address),
    ):
        pass
