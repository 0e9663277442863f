"""A Dask cluster of two worker processes on this machine, as a user would start one."""

import logging

import pytest

from kb.core import dask_engine


@pytest.fixture(autouse=True)
def _a_busy_machine_may_take_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that was killed is started again: a new Python that imports everything, before it
    answers.
    """
    monkeypatch.setattr(dask_engine, "WORKERS_S", 600.0)
    monkeypatch.setattr(dask_engine, "ANSWER_S", 120.0)


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    distributed = pytest.importorskip("distributed")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            local_directory=str(tmp_path_factory.mktemp("dask")),
            silence_logs=logging.CRITICAL,
            host="127.0.0.1",
        ) as made,
    ):
        yield made


@pytest.fixture
def kill_a_worker(cluster):
    """Kills one worker process of the cluster once `when()` is true; Dask starts another. One that
    is killed while it starts is never started again.
    """
    import os
    import signal
    import threading

    from distributed import Status

    killed: list[int] = []
    threads = []

    def arrange(when):
        end = threading.Event()

        def watch():
            while not end.wait(0.01):
                started = [
                    nanny.pid
                    for nanny in cluster.workers.values()
                    if nanny.process is not None and nanny.process.status == Status.running
                ]
                if started and when():
                    os.kill(started[0], signal.SIGKILL)
                    killed.append(started[0])
                    return

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        threads.append((end, thread))
        return killed

    yield arrange
    for end, thread in threads:
        end.set()
        thread.join()
