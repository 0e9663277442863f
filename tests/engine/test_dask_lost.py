"""A Dask cluster that goes away, or that never gets workers: one clear line and exit 3,
and signals are heard.
"""

import contextlib
import logging
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from kb.core import dask_engine, signals
from kb.core.engine import make_executor
from kb.core.errors import Interrupted, Unreachable

sys.path.insert(0, str(Path(__file__).parent))
import tasks

from tests.conftest import needs

needs("distributed")


pytestmark = pytest.mark.dask


class Own:
    """A scheduler and its worker as processes of their own, as a user starts them."""

    def __init__(self, place: Path) -> None:
        self.place, self.processes = place, {}
        self.begun = place / "begun"
        self.start(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--scheduler-file",
            str(place / "file"),
        )
        line = self.processes["scheduler"].stderr
        found = next(text for text in line if "Scheduler at:" in text)
        self.address = found.rpartition("Scheduler at:")[2].strip()
        threading.Thread(target=line.read, daemon=True).start()

    def start(self, what: str, *words: str) -> None:
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
        command = [sys.executable, "-m", "dask", what, *words]
        err = subprocess.PIPE if what == "scheduler" else subprocess.DEVNULL
        self.processes[what] = subprocess.Popen(
            command,
            cwd=self.place,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=err,
            text=True,
        )

    def worker(self) -> None:
        self.start("worker", self.address, "--no-nanny", "--no-dashboard", "--nthreads", "1")

    def kill(self, what: str) -> None:
        self.processes[what].kill()

    def when_begun(self, do) -> None:
        """Call `do` from another thread once the task is being worked on."""

        def watch() -> None:
            for _ in range(6000):
                if self.begun.exists():
                    return do()
                threading.Event().wait(0.01)
            return None

        threading.Thread(target=watch, daemon=True).start()


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_engine, "LOOK_S", 0.3)
    made = Own(tmp_path)
    yield made
    signals.stop.clear()
    for process in made.processes.values():
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        process.wait()


def test_a_scheduler_that_dies_is_exit_3_and_one_line(own, capfd, caplog):
    own.worker()
    with (
        pytest.raises(Unreachable, match="went away") as error,
        make_executor("dask", 1, own.address) as pool,
    ):
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: own.kill("scheduler"))
        future.result()
    assert error.value.exit_code == 3
    assert error.value.hint
    assert [record for record in caplog.records if record.name.startswith("distributed")] == []
    assert "Traceback" not in capfd.readouterr().err


def test_when_no_worker_is_left_it_says_so_once_and_ends(own, caplog, monkeypatch):
    own.worker()
    caplog.set_level(logging.WARNING, "kb.dask")
    with (
        pytest.raises(Unreachable, match="no Dask worker at") as error,
        make_executor("dask", 1, own.address) as pool,
    ):
        monkeypatch.setattr(dask_engine, "WORKERS_S", 1.0)
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: own.kill("worker"))
        future.result()
    assert error.value.exit_code == 3
    assert [record.name for record in caplog.records if "no Dask worker at" in record.message] == [
        "kb.dask"
    ]


class Heard(logging.Handler):
    """Asks to stop when the wait for workers was announced."""

    def emit(self, record: logging.LogRecord) -> None:
        signals.stop.request("SIGTERM")


@pytest.fixture
def stop_when_told():
    log, handler = logging.getLogger("kb.dask"), Heard()
    log.addHandler(handler)
    yield
    log.removeHandler(handler)


def test_sigterm_is_heard_while_the_cluster_has_no_worker_yet(own, stop_when_told):
    with pytest.raises(Interrupted), make_executor("dask", 1, own.address):
        pass


def test_sigterm_is_heard_after_all_workers_were_killed(own, stop_when_told):
    own.worker()
    with pytest.raises(Interrupted), make_executor("dask", 1, own.address) as pool:
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: own.kill("worker"))
        future.result()


def test_sigterm_leaves_the_task_in_hand_some_seconds(own, monkeypatch):
    monkeypatch.setattr(dask_engine, "HAND_S", 0.5)
    own.worker()
    with pytest.raises(Interrupted), make_executor("dask", 1, own.address) as pool:
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: signals.stop.request("SIGTERM"))
        future.result()
