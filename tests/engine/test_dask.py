"""The Dask engine behind the executor seam: order, errors, dying workers, wrong settings,
and clusters that go away or never get workers.
"""

import contextlib
import logging
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest

from kb.cli.framework.exit_codes import describe
from kb.core import dask_engine, signals
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import (
    DiskFull,
    FatalError,
    Interrupted,
    MissingExtra,
    SettingError,
    Unreachable,
)

sys.path.insert(0, str(Path(__file__).parent))
import tasks

from tests.conftest import ROOT, needs

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
    assert re.search(r"\(on the Dask worker tcp://127.0.0.1:\d+\)", describe(error.value)[0])


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


def test_a_wrong_address_is_exit_2_and_a_silent_one_exit_4(monkeypatch):
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
    assert error.value.exit_code == 4


def test_without_the_extra_it_is_exit_2(monkeypatch):
    monkeypatch.setattr(dask_engine.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra) as error:
        dask_engine.check_scheduler("tcp://127.0.0.1:1")
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


@pytest.mark.parametrize("what", ["Lorecrawl", "Python", "pyarrow"])
def test_a_worker_that_has_something_else_is_refused(cluster, monkeypatch, what):
    ours = dask_engine.description

    def other(*places):
        return {**ours(*places), what: "9.9"}

    # This process differs from the workers, which run the function by its name.
    other.__module__, other.__qualname__ = ours.__module__, ours.__qualname__
    with monkeypatch.context() as patched:
        patched.setattr(dask_engine, "description", other)
        with (
            pytest.raises(SettingError, match=rf"tcp://127.0.0.1:\d+ has {what} .*, not 9\.9"),
            make_executor("dask", 1, cluster.scheduler_address),
        ):
            pass


def test_slots_are_the_clusters_and_workers_lowers_them(cluster):
    cluster.wait_for_workers(2)  # earlier tests kill some, which Dask starts again
    for most, window in ((None, 4), (8, 4), (1, 1)):
        with make_executor("dask", 1, cluster.scheduler_address, most=most) as executor:
            assert executor.window == window


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

    def start(
        self,
        what: str,
        *words: str,
        code: str = "",
        place: Path | None = None,
        before: Sequence[str] = (),
    ) -> None:
        paths = (str(Path(__file__).parent), code, str(ROOT))  # this code, wherever it is installed
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        command = [*before, sys.executable, "-m", "dask", what, *words]
        err = subprocess.PIPE if what == "scheduler" else subprocess.DEVNULL
        if what in self.processes:
            what = f"{what} {len(self.processes)}"
        self.processes[what] = subprocess.Popen(
            command,
            cwd=place or self.place,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=err,
            text=True,
        )

    def worker(self, **options) -> None:
        words = ("--no-nanny", "--no-dashboard", "--nthreads", "1")
        self.start("worker", self.address, *words, **options)

    def kill(self, what: str) -> None:
        self.processes[what].kill()

    def when_begun(self, do) -> None:
        """Call `do` from another thread once the task is being worked on."""

        def watch() -> None:
            while not self.begun.exists():
                threading.Event().wait(0.01)
            do()

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


def test_a_scheduler_that_dies_is_exit_4_and_one_line(own, capfd, caplog):
    own.worker()
    with (
        pytest.raises(Unreachable, match="went away") as error,
        make_executor("dask", 1, own.address) as pool,
    ):
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: own.kill("scheduler"))
        future.result()
    assert error.value.exit_code == 4
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
        caplog.clear()  # the wait for the worker to start
        future = pool.submit(tasks.linger, str(own.place))
        own.when_begun(lambda: own.kill("worker"))
        future.result()
    assert error.value.exit_code == 4
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


def test_a_worker_that_sees_another_folder_as_the_data_root_is_refused(own, tmp_path, monkeypatch):
    """Under the same path, as with a copy of the root on each machine."""
    for place in ("here", "there"):
        (tmp_path / place / "data").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    root = Path("/proc/self/cwd/data")  # of each process its own
    own.worker(place=tmp_path / "there")
    with (
        pytest.raises(SettingError, match=f"does not see {root}"),
        make_executor("dask", 1, own.address, root),
    ):
        pass
    assert not list(root.iterdir())
    own.kill("worker")


def test_a_late_worker_with_other_code_gets_no_work(own, tmp_path, caplog):
    caplog.set_level(logging.WARNING, "kb.dask")
    for name in ("kb", "schemas", "pipelines"):
        shutil.copytree(Path(dask_engine.__file__).parents[2] / name, tmp_path / "other" / name)
    (tmp_path / "other/kb/core/licences.py").open("a").write("\n# changed\n")
    own.worker()
    with make_executor("dask", 1, own.address, tmp_path) as pool:
        first = pool.submit(os.getpid).result()
        own.worker(code=str(tmp_path / "other"))
        told = threading.Event()
        while not any("gets no work: it has Lorecrawl" in one.message for one in caplog.records):
            pool.submit(os.getpid).result()
            pool._cluster.require_workers()
            assert not told.wait(0.1)
        pids = set(map_in_order(pool, tasks.pid_of, ((n,) for n in range(12)), window=6))
        assert pids == {first}
    assert len([one for one in caplog.records if "gets no work" in one.message]) == 1


def test_a_late_worker_that_is_fit_takes_over_from_one_that_died(own, tmp_path):
    own.worker()
    with make_executor("dask", 1, own.address, tmp_path) as pool:
        future = pool.submit(tasks.linger_once, str(own.place))

        def change() -> None:
            own.kill("worker")
            own.worker()

        own.when_begun(change)
        assert future.result() == "done"


def test_a_worker_that_hangs_is_named(own, tmp_path, monkeypatch):
    monkeypatch.setattr(dask_engine, "ANSWER_S", 1.0)
    own.worker()
    with make_executor("dask", 1, own.address, tmp_path) as pool:
        assert pool.submit(tasks.square, 3).result() == 9
    own.processes["worker"].send_signal(signal.SIGSTOP)
    try:
        with (
            pytest.raises(SettingError, match="does not answer within 1 s"),
            make_executor("dask", 1, own.address, tmp_path),
        ):
            pass
    finally:
        own.processes["worker"].send_signal(signal.SIGCONT)


def test_a_worker_without_lorecrawl_is_named_at_once(own, tmp_path):
    (tmp_path / "other" / "kb").mkdir(parents=True)
    (tmp_path / "other" / "kb" / "__init__.py").touch()
    own.worker(code=str(tmp_path / "other"))
    with (
        pytest.raises(SettingError, match="can't run this Lorecrawl"),
        make_executor("dask", 1, own.address, tmp_path),
    ):
        pass


def test_tls_without_certificates_is_exit_2():
    with pytest.raises(SettingError, match="no certificates are set"):
        dask_engine.check_scheduler("tls://10.0.0.1:8786")


def test_the_disk_of_one_worker_that_is_full_is_named(own, tmp_path):
    """The error keeps its kind, so that the command ends resumable, and says where."""
    own.worker()
    with (
        make_executor("dask", 1, own.address, tmp_path) as pool,
        pytest.raises(DiskFull) as error,
    ):
        pool.submit(tasks.fill_up, "/dev/full").result()
    message, _, code = describe(error.value)
    assert code == 4
    assert "(on the Dask worker tcp://127.0.0.1:" in message


def test_a_worker_that_has_too_little_memory_is_named(own, tmp_path):
    own.worker()
    with (
        make_executor("dask", 1, own.address, tmp_path) as pool,
        pytest.raises(MemoryError) as error,
    ):
        pool.submit(tasks.take_memory).result()
    message, hint, code = describe(error.value)
    assert re.fullmatch(r"out of memory \(on the Dask worker tcp://127.0.0.1:\d+\)", message)
    assert (hint, code) == ("try fewer --workers", 1)


def test_a_worker_that_can_only_read_the_data_root_is_refused(own, tmp_path):
    """In a mount namespace of its own, as on a machine that mounts the folder read-only."""
    root = tmp_path / "data"
    root.mkdir()
    read_only = f"mount --bind {root} {root} && mount -o remount,ro,bind {root}"
    unshared = ("unshare", "--mount", "sh", "-c")
    if os.geteuid() or subprocess.run([*unshared, read_only], check=False).returncode:
        pytest.skip("nothing can be mounted here")
    own.worker(before=(*unshared, f'{read_only} && exec "$@"', "sh"))
    with (
        pytest.raises(SettingError, match=f"can't write to {root}"),
        make_executor("dask", 1, own.address, root),
    ):
        pass
