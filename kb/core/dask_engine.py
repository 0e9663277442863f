"""The executor of `--engine dask`: tasks go to the workers of a Dask cluster.

Every worker needs the same Lorebase and sees the data root under the same path (a shared folder).
A task that was on a worker that died is run again on another one: tasks write whole files or none.
Source: https://distributed.dask.org/en/stable/client.html, …/resilience.html
"""

from __future__ import annotations

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
from kb.core.errors import FatalError, KbError, MissingExtra, SettingError, Unreachable

CONNECT_S, WORKERS_S = 15.0, 120.0  # a queue may take its time to start the first worker
_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx|inproc)://.+|[\w.\-]+:\d+")
# What a worker must know of this process to give the same bytes.
_SHARED = ("KB_NOW", "SOURCE_DATE_EPOCH")


def check(scheduler: str | None) -> None:
    """Raise MissingExtra or SettingError before anything is sent or written."""
    if importlib.util.find_spec("distributed") is None:
        raise MissingExtra("--engine dask needs dask and distributed", hint='run `pip install "lorebase[dask]"`')
    if scheduler and not _ADDRESS.fullmatch(scheduler):
        raise SettingError(f"--scheduler is {scheduler!r}", hint="write it like tcp://10.0.0.1:8786")


@contextlib.contextmanager
def dask_executor(scheduler: str | None, workers: int = 1) -> Iterator[Executor]:
    """An executor on the cluster at `scheduler`, or on one of `workers` processes that ends with the block.

    Raises MissingExtra, SettingError (no such kind of address), Unreachable (no scheduler, or no
    worker in time), FatalError (workers without this Lorebase, or ones that keep dying).
    """
    check(scheduler)
    import dask
    from distributed import Client, LocalCluster

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.comm.timeouts.connect": f"{CONNECT_S:.0f}s"}))
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="kb-dask-"))
            target: Any = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address=":0",
                    local_directory=folder,
                    silence_logs=logging.CRITICAL,
                    worker_dashboard_address=None,
                )
            )
        else:
            target = scheduler
        try:
            client = stack.enter_context(Client(target, timeout=f"{CONNECT_S:.0f}s", set_as_default=False))
            client.wait_for_workers(1, timeout=WORKERS_S)
        except (OSError, TimeoutError) as error:
            raise Unreachable(
                f"no Dask scheduler with workers at {scheduler or 'this machine'} ({type(error).__name__})",
                hint="start it, and its workers; the same command goes on then",
            ) from None
        pool = _Pool(client)
        _same_lorebase(pool)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


class _Pool(Executor):
    """`concurrent.futures` in front of a Dask client."""

    def __init__(self, client: Any) -> None:
        self._inner = client.get_executor(pure=False)
        self._environment = {name: os.environ.get(name) for name in _SHARED}

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the call on some worker."""
        return _Future(self._inner.submit(_call, self._environment, fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Forget what is still running; the cluster stays."""
        self._inner.shutdown(wait=wait and not cancel_futures)


class _Future(Future[Any]):
    """A future whose errors are those of this project."""

    def __init__(self, inner: Future[Any]) -> None:
        super().__init__()
        self._inner = inner

    def result(self, timeout: float | None = None) -> Any:
        """The task's result. Raises FatalError when every worker that took it died."""
        from distributed.scheduler import KilledWorker

        try:
            return self._inner.result(timeout)
        except KilledWorker as error:
            raise FatalError("several Dask workers died of the same task", hint="they may need more memory; see their logs") from error

    def cancel(self) -> bool:
        """Ask the cluster not to run it."""
        return self._inner.cancel()

    def done(self) -> bool:
        """Whether there is a result or an error."""
        return self._inner.done()


def _call(environment: dict[str, str | None], fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Runs on a worker."""
    for name, value in environment.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    return fn(*args, **kwargs)


def _version() -> str:
    return __version__


def _same_lorebase(pool: Executor) -> None:
    try:
        theirs = pool.submit(_version).result(WORKERS_S)
    except KbError:
        raise
    except Exception as error:  # whatever a worker without this package says when it unpickles the call
        raise FatalError(
            f"the Dask workers can't run Lorebase ({type(error).__name__}: {error})",
            hint="install the same version on every machine of the cluster",
        ) from error
    if theirs != __version__:
        raise FatalError(
            f"the Dask workers have Lorebase {theirs}, this is {__version__}",
            hint="install the same version on every machine of the cluster",
        )
