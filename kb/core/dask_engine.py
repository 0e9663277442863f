"""The executor of `--engine dask`: tasks go to the workers of a Dask cluster.

Every worker needs this Lorecrawl, these packages and this Python, and sees the data root, and what
else its tasks read or write, under the same path (a shared folder): each one is asked before it
gets a task, also one that joins late.
A task that was on a worker that died is run again on another one: tasks write whole files or none.
Every wait goes in short slices: a signal, a lost scheduler and a cluster without workers end it.
Source: https://distributed.dask.org/en/stable/client.html, …/resilience.html
"""

import concurrent.futures
import contextlib
import importlib.metadata
import importlib.util
import logging
import os
import platform
import re
import secrets
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from kb.core import clock, signals
from kb.core.arrow_without_pandas import without_pandas
from kb.core.errors import FatalError, MissingExtra, SettingError, Unreachable
from kb.core.installation import asyncio, code_digest, install_extra
from kb.version import __version__

CONNECT_S, WORKERS_S = 15.0, 120.0  # a queue may take its time to start the first worker
SLICE_S, LOOK_S = 0.2, 3.0  # between looks for a signal; between questions after the workers
ANSWER_S = 10.0  # for a worker's answer to what it has
HAND_S = 10.0  # how long the task in hand may take to end after a signal
_RECORDS = "kb-log"  # the topic of what workers log
_TRIES = 3  # of a task whose workers have all gone
_log = logging.getLogger("kb.dask")
_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx|inproc)://.+|[\w.\-]+:\d+")
# What a worker must know of this process to give the same bytes.
_SHARED = ("KB_NOW", "SOURCE_DATE_EPOCH")
_WRITES, _SEES = "write access to ", "sight of "
# What makes bytes. A package that this process lacks may be missing elsewhere too.
_PACKAGES = (
    *("ahocorasick-rs", "av", "duckdb", "lingua-language-detector", "msgspec", "numpy"),
    *("onnxruntime", "orjson", "pillow", "pyarrow", "rensa", "scenedetect-headless", "tokenizers"),
    *("torch", "transformers", "zstandard"),
)


def check_scheduler(scheduler: str | None) -> None:
    """Raise MissingExtra or SettingError before anything is sent or written."""
    if importlib.util.find_spec("distributed") is None:
        raise MissingExtra("--engine dask needs dask and distributed", hint=install_extra("dask"))
    if scheduler and not _ADDRESS.fullmatch(scheduler):
        raise SettingError(
            f"--scheduler is {scheduler!r}", hint="write it like tcp://10.0.0.1:8786"
        )
    if scheduler and scheduler.startswith("tls://"):
        import dask
        import distributed  # noqa: F401  its settings

        if not dask.config.get("distributed.comm.tls.ca-file", None):
            raise SettingError(
                f"--scheduler is {scheduler}, and no certificates are set",
                hint="set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__TLS__CLIENT__CERT and"
                " …__TLS__CLIENT__KEY; see docs/many-machines.md",
            )


@contextlib.contextmanager
def dask_executor(
    scheduler: str | None,
    workers: int = 1,
    root: Path | None = None,
    most: int | None = None,
    reads: Sequence[Path] = (),
) -> Iterator["Pool"]:
    """An executor on the cluster at `scheduler`, or on one of `workers` processes that ends with
    the block. At most `most` tasks are on their way at once. Workers must see `root`, a folder that
    tasks write to, and the places that they read.

    Raises MissingExtra, SettingError (no such kind of address, or a worker that is not fit),
    Unreachable (no scheduler, or no worker in time), Interrupted, FatalError (workers that keep
    dying).
    """
    check_scheduler(scheduler)
    import dask
    from distributed import Client, LocalCluster

    # What Dask logs about lost connections is said by this project's errors; its loggers have
    # levels of their own.
    known = [name for name in logging.root.manager.loggerDict if name.startswith("distributed.")]
    for name in ("distributed", *known):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        stack.enter_context(
            dask.config.set({"distributed.comm.timeouts.connect": f"{CONNECT_S:.0f}s"})
        )
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="kb-dask-"))
            target: Any = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    # Whoever reaches its ports can run code here, without a password.
                    host="127.0.0.1",
                    scheduler_kwargs={"dashboard": False},
                    dashboard_address="127.0.0.1:0",  # a free port; its plain pages are left
                    local_directory=folder,
                    silence_logs=logging.CRITICAL,
                    worker_dashboard_address=None,
                )
            )
        else:
            target = scheduler
        where = scheduler or "this machine"
        try:
            client = Client(target, timeout=f"{CONNECT_S:.0f}s", set_as_default=False)
        except (OSError, TimeoutError) as error:
            raise _unreachable(f"no Dask scheduler at {where} ({type(error).__name__})") from None
        stack.callback(_close, client)
        client.subscribe_topic(_RECORDS, _log_here)
        cluster = Cluster(client, where, root, reads)
        cluster.begin()
        pool = Pool(cluster, most)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


def survey(scheduler: str | None, root: Path | None) -> list[tuple[str, int, str]]:
    """(address, threads, how it differs from this process) of each worker. Raises SettingError,
    MissingExtra, Unreachable.
    """
    if scheduler is None:
        raise SettingError("--engine dask needs --scheduler", hint="name the cluster's address")
    check_scheduler(scheduler)
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client: Any = Client(scheduler, timeout=f"{CONNECT_S:.0f}s", set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise _unreachable(f"no Dask scheduler at {scheduler} ({type(error).__name__})") from None
    try:
        cluster = Cluster(client, scheduler, root)
        threads = client.sync(client.scheduler.ncores, callback_timeout=LOOK_S)
        cluster.look()
    finally:
        _close(client)
    if not threads:
        raise _unreachable(f"no Dask worker at {scheduler}")
    return [
        (address, threads[address], cluster.unfit.get(address, "")) for address in sorted(threads)
    ]


class Cluster:
    """The workers of a scheduler that may go away, lose workers, or have none yet.

    `fit` are the threads of those that were asked and are as this process, by address; `unfit` says
    of others how they differ. Raises as `dask_executor`.
    """

    def __init__(
        self, client: Any, where: str, root: Path | None = None, reads: Sequence[Path] = ()
    ) -> None:
        self.client, self._where, self._root = client, where, root
        self._reads = [str(path) for path in reads]
        self.fit: dict[str, int] = {}
        self.unfit: dict[str, str] = {}
        self._asked = clock.monotonic()
        self._alone: float | None = None  # since when it has no worker

    def begin(self) -> None:
        """Wait for the first workers. Raises SettingError unless all that are there are fit."""
        self.look()
        while not self.fit and not self.unfit:
            signals.stop.raise_if_asked()
            self.require_workers()
            signals.stop.wait(SLICE_S)
            self.look()
        if self.unfit:
            address, why = next(iter(self.unfit.items()))
            others = f" (and {len(self.unfit) - 1} more)" if len(self.unfit) > 1 else ""
            raise SettingError(
                f"the Dask worker {address} {why}{others}",
                hint="every machine needs this Lorecrawl, these packages and the same folders under"
                " the same paths; start workers again after an upgrade",
            )
        self._alone = None

    def look(self) -> set[str]:
        """Ask the scheduler for its workers, and new ones what they have; the addresses of those
        that are there, none when it doesn't answer.
        """
        try:
            there = self.client.sync(self.client.scheduler.ncores, callback_timeout=LOOK_S)
        except (OSError, TimeoutError, asyncio.CancelledError):
            return set()
        for address in self.fit.keys() - there:
            del self.fit[address]
        new = [address for address in there if address not in {**self.fit, **self.unfit}]
        for address, why in self._differences(new) if new else ():
            if why:
                self.unfit[address] = why
            else:
                self.fit[address] = there[address]
        return set(there)

    def require_workers(self) -> None:
        """Raise Unreachable when the scheduler is lost, or no worker was there for `WORKERS_S`."""
        if self.client.status != "running":
            raise self.lost()
        now = clock.monotonic()
        if now - self._asked < LOOK_S:
            return
        self._asked, known = now, set(self.unfit)
        self.look()
        for address in self.unfit.keys() - known if self.fit else ():
            why = self.unfit[address]
            _log.warning("the Dask worker %s gets no work: it %s", address, why)
        if self.fit:
            self._alone = None
        elif self._alone is None:
            self._alone = now
            _log.warning("no Dask worker at %s; waiting %d s for one", self._where, WORKERS_S)
        elif now - self._alone >= WORKERS_S:
            raise _unreachable(f"no Dask worker at {self._where}")

    def lost(self) -> Unreachable:
        """The error of a scheduler that went away."""
        return Unreachable(
            f"the Dask scheduler at {self._where} went away",
            hint="start it again; the same command resumes",
        )

    def _differences(self, addresses: list[str]) -> Iterator[tuple[str, str]]:
        """How each of these workers differs from this process, "" for one that does not."""
        token = None
        if self._root is not None:
            token = self._root / f".dask-{secrets.token_hex(8)}.tmp"
            token.parent.mkdir(parents=True, exist_ok=True)
            token.touch()
        try:
            ours = description(str(token or ""), self._reads)
            theirs = self.client.sync(_ask, self.client, addresses, str(token or ""), self._reads)
        finally:
            if token is not None:
                token.unlink(missing_ok=True)
        for address, answer in zip(addresses, theirs, strict=True):
            if isinstance(answer, TimeoutError):
                yield address, f"does not answer within {ANSWER_S:.0f} s"
            elif not isinstance(answer, dict):
                yield address, f"can't run this Lorecrawl ({type(answer).__name__}: {answer})"
            else:
                differing = [name for name in ours if answer.get(name) != ours[name]]
                unseen = [name for name in differing if name.startswith(_SEES)]
                if unseen:
                    yield address, f"does not see {unseen[0].removeprefix(_SEES)}"
                elif f"{_WRITES}{self._root}" in differing:
                    yield address, f"can't write to {self._root}"
                else:
                    has = (
                        f"{package} {answer.get(package, 'none')}, not {ours[package]}"
                        for package in differing
                    )
                    yield address, f"has {'; '.join(has)}" if differing else ""


async def _ask(client: Any, addresses: list[str], token: str, reads: list[str]) -> list[Any]:
    """What each worker says of itself, or the error instead."""

    async def asked(address: str) -> Any:
        answers = client._run(
            description, token, reads, workers=[address], wait=True, nanny=False, on_error="return"
        )
        return (await asyncio.wait_for(answers, ANSWER_S))[address]

    return await asyncio.gather(*map(asked, addresses), return_exceptions=True)


def description(token: str, reads: Sequence[str] = ()) -> dict[str, str]:
    """What must be equal on all machines of a run; runs on a worker. `token` is a file that the
    client has just written into the folder that tasks write to; `reads` are places that they read.
    """
    versions: dict[str, str] = {}
    for name in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    if token:
        folder = Path(token).parent
        versions[f"{_SEES}{folder}"] = str(Path(token).exists())
        versions[f"{_WRITES}{folder}"] = str(os.access(folder, os.W_OK))
    versions |= {f"{_SEES}{path}": str(Path(path).exists()) for path in reads}
    python = ".".join(platform.python_version_tuple()[:2])
    return {"Lorecrawl": f"{__version__} ({code_digest()[:12]})", "Python": python, **versions}


class Pool(Executor):
    """`concurrent.futures` in front of a Dask client. `window`: how many tasks keep it busy."""

    def __init__(self, cluster: Cluster, most: int | None = None) -> None:
        self._cluster, self._most = cluster, most
        self._environment = {name: os.environ.get(name) for name in _SHARED}

    @property
    def window(self) -> int:
        """Two tasks a slot of the cluster, unless fewer slots were asked for."""
        slots = sum(self._cluster.fit.values())
        return self._most if self._most and self._most < slots else 2 * slots

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call on some worker. Raises Unreachable when the scheduler is gone."""
        if self._cluster.client.status != "running":
            raise self._cluster.lost()
        return _Future(self._cluster, (self._environment, fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """The cluster stays; what is still running is forgotten with the client."""


class _Future(Future[Any]):
    """A future whose errors are those of this project."""

    def __init__(self, cluster: Cluster, call: tuple[Any, ...]) -> None:
        super().__init__()
        self._cluster, self._task, self._tries = cluster, call, 0
        self._send()

    def _send(self) -> None:
        """Hand the call to the fit workers, which may be others than before."""
        self._workers = set(self._cluster.fit)
        pool = self._cluster.client.get_executor(pure=False, workers=list(self._workers))
        self._inner, self._tries = pool.submit(_call, *self._task), self._tries + 1

    def result(self, timeout: float | None = None) -> Any:
        """The task's result.

        Raises FatalError when every worker that took it died, Unreachable when the scheduler is
        lost or no worker is left for `WORKERS_S`, Interrupted, TimeoutError.
        """
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        try:
            return self._wait(timeout)
        except KilledWorker as error:
            raise _deadly() from error
        # What a task itself raises is not one of these.
        except (concurrent.futures.CancelledError, asyncio.CancelledError, CommClosedError):
            raise self._cluster.lost() from None

    def _wait(self, timeout: float | None) -> Any:
        start = clock.monotonic()
        stopped = None  # since when it was asked to stop
        while True:
            with contextlib.suppress(concurrent.futures.TimeoutError):
                return self._inner.result(SLICE_S)
            if self._inner.done():  # the task itself raised a TimeoutError
                return self._inner.result(0)
            now = clock.monotonic()
            if timeout is not None and now - start >= timeout:
                raise concurrent.futures.TimeoutError
            self._cluster.require_workers()
            if self._cluster.fit and not self._workers & self._cluster.fit.keys():
                if self._tries >= _TRIES:
                    raise _deadly()
                self._inner.cancel()
                self._send()
            if signals.stop.requested():
                stopped = now if stopped is None else stopped
                if now - stopped >= HAND_S or not self._cluster.look():
                    signals.stop.raise_if_asked()

    def cancel(self) -> bool:
        """Ask the cluster not to run it."""
        return self._inner.cancel()

    def done(self) -> bool:
        """Whether there is a result or an error."""
        return self._inner.done()


def _deadly() -> FatalError:
    return FatalError(
        "several Dask workers died on the same task",
        hint="they may need more memory; see their logs",
    )


def _close(client: Any) -> None:
    """End the client; one whose scheduler is gone waits for no answer."""
    with contextlib.suppress(Exception):
        client.close(timeout=CONNECT_S if client.status == "running" else SLICE_S)


def _unreachable(what: str) -> Unreachable:
    return Unreachable(what, hint="start it, and its workers; then run the same command to resume")


def _log_here(event: tuple[float, dict[str, Any]]) -> None:
    """Log what a worker has logged."""
    record = logging.makeLogRecord(event[1])
    logging.getLogger(record.name).handle(record)


class _ToClient(logging.Handler):
    """Sends what a worker's task logs to the process of the command."""

    def emit(self, record: logging.LogRecord) -> None:
        """Never raises."""
        from distributed import get_worker

        names = ("name", "levelno", "levelname", "process")
        with contextlib.suppress(Exception):
            about = {name: getattr(record, name) for name in names}
            get_worker().log_event(_RECORDS, {**about, "msg": record.getMessage()})


def _call(
    environment: dict[str, str | None],
    fn: Callable[..., Any],
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
) -> Any:
    """Runs on a worker. An error names the machine in a note."""
    for name, value in environment.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    without_pandas()
    root = logging.getLogger()
    root.handlers[:] = [_ToClient(logging.WARNING)]
    try:
        return fn(*args, **kwargs)
    except Exception as error:
        from distributed import get_worker

        error.add_note(f"on the Dask worker {get_worker().address}")
        raise
