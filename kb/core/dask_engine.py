"""The executor of `--engine dask`: tasks go to the workers of a Dask cluster.

Every worker needs the same Lorecrawl and sees the data root under the same path (a shared folder).
A task that was on a worker that died is run again on another one: tasks write whole files or none.
Every wait goes in short slices: a signal, a lost scheduler and a cluster without workers end it.
Source: https://distributed.dask.org/en/stable/client.html, …/resilience.html
"""

import asyncio
import concurrent.futures
import contextlib
import importlib.util
import logging
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from typing import Any

from kb import __version__
from kb.core import clock, signals
from kb.core.arrow_without_pandas import without_pandas
from kb.core.errors import FatalError, KbError, MissingExtra, SettingError, Unreachable
from kb.core.installation import install_extra

CONNECT_S, WORKERS_S = 15.0, 120.0  # a queue may take its time to start the first worker
SLICE_S, LOOK_S = 0.2, 3.0  # between looks for a signal; between questions after the workers
HAND_S = 10.0  # how long the task in hand may take to end after a signal
_log = logging.getLogger("kb.dask")
_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx|inproc)://.+|[\w.\-]+:\d+")
# What a worker must know of this process to give the same bytes.
_SHARED = ("KB_NOW", "SOURCE_DATE_EPOCH")


def check(scheduler: str | None) -> None:
    """Raise MissingExtra or SettingError before anything is sent or written."""
    if importlib.util.find_spec("distributed") is None:
        raise MissingExtra("--engine dask needs dask and distributed", hint=install_extra("dask"))
    if scheduler and not _ADDRESS.fullmatch(scheduler):
        raise SettingError(
            f"--scheduler is {scheduler!r}", hint="write it like tcp://10.0.0.1:8786"
        )


@contextlib.contextmanager
def dask_executor(scheduler: str | None, workers: int = 1) -> Iterator[Executor]:
    """An executor on the cluster at `scheduler`, or on one of `workers` processes that ends with
    the block.

    Raises MissingExtra, SettingError (no such kind of address), Unreachable (no scheduler, or no
    worker in time), Interrupted, FatalError (workers without this Lorecrawl, or ones that keep
    dying).
    """
    check(scheduler)
    import dask
    from distributed import Client, LocalCluster

    _hush()
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
                    # Whoever reaches its ports can run code here, and nobody is asked who he is.
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
        pool = _Pool(_Cluster(client, where))
        _same_lorecrawl(pool)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


class _Cluster:
    """A cluster whose scheduler may go away and that may lose its workers, or have none yet."""

    def __init__(self, client: Any, where: str) -> None:
        self.client, self._where = client, where
        self._asked = clock.monotonic()
        self._alone: float | None = None  # since when it has no worker
        while not self.workers():
            signals.stop.check()
            self.check()
            signals.stop.wait(SLICE_S)

    def workers(self) -> int:
        """How many workers the scheduler has now; 0 also when it doesn't answer."""
        try:
            return len(self.client.sync(self.client.scheduler.ncores, callback_timeout=LOOK_S))
        except (OSError, TimeoutError, asyncio.CancelledError):
            return 0

    def check(self) -> None:
        """Raise Unreachable when the scheduler is lost, or no worker was there for `WORKERS_S`."""
        if self.client.status != "running":
            raise self.lost()
        now = clock.monotonic()
        if now - self._asked < LOOK_S:
            return
        self._asked = now
        if self.workers():
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


class _Pool(Executor):
    """`concurrent.futures` in front of a Dask client."""

    def __init__(self, cluster: _Cluster) -> None:
        self._inner, self._cluster = cluster.client.get_executor(pure=False), cluster
        self._environment = {name: os.environ.get(name) for name in _SHARED}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call on some worker. Raises Unreachable when the scheduler is gone."""
        if self._cluster.client.status != "running":
            raise self._cluster.lost()
        return _Future(
            self._inner.submit(_call, self._environment, fn, args, kwargs), self._cluster
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Forget what is still running; the cluster stays."""
        if self._cluster.client.status == "running":
            self._inner.shutdown(wait=wait and not cancel_futures)


class _Future(Future[Any]):
    """A future whose errors are those of this project."""

    def __init__(self, inner: Future[Any], cluster: _Cluster) -> None:
        super().__init__()
        self._inner, self._cluster = inner, cluster

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
            raise FatalError(
                "several Dask workers died on the same task",
                hint="they may need more memory; see their logs",
            ) from error
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
            self._cluster.check()
            if signals.stop.requested():
                stopped = now if stopped is None else stopped
                if now - stopped >= HAND_S or not self._cluster.workers():
                    signals.stop.check()

    def cancel(self) -> bool:
        """Ask the cluster not to run it."""
        return self._inner.cancel()

    def done(self) -> bool:
        """Whether there is a result or an error."""
        return self._inner.done()


def _hush() -> None:
    """What Dask logs about lost connections is said by this project's errors;
    its loggers have levels of their own.
    """
    for name in (
        "distributed",
        *(name for name in logging.root.manager.loggerDict if name.startswith("distributed.")),
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _close(client: Any) -> None:
    """End the client; one whose scheduler is gone has nobody left to tell."""
    with contextlib.suppress(Exception):
        client.close(timeout=CONNECT_S if client.status == "running" else SLICE_S)


def _unreachable(what: str) -> Unreachable:
    return Unreachable(what, hint="start it, and its workers; then run the same command to resume")


def _call(
    environment: dict[str, str | None],
    fn: Callable[..., Any],
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
) -> Any:
    """Runs on a worker."""
    for name, value in environment.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    without_pandas()
    return fn(*args, **kwargs)


def _version() -> str:
    return __version__


def _same_lorecrawl(pool: Executor) -> None:
    try:
        theirs = pool.submit(_version).result(WORKERS_S)
    except KbError:
        raise
    except concurrent.futures.TimeoutError:
        raise _unreachable("the Dask workers take no task") from None
    except (
        Exception
    ) as error:  # whatever a worker without this package says when it unpickles the call
        raise FatalError(
            f"the Dask workers can't run Lorecrawl ({type(error).__name__}: {error})",
            hint="install the same version on every machine of the cluster",
        ) from error
    if theirs != __version__:
        raise FatalError(
            f"the Dask workers have Lorecrawl {theirs}, this is {__version__}",
            hint="install the same version on every machine of the cluster",
        )
