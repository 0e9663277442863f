"""The one engine seam: concurrent.futures.Executor. No stage knows which engine runs it.

A task is a small tuple of strings and numbers (paths, names); its result is paths and counts.
Results come back in the order of the tasks, whatever order they were done in, so that output
never depends on the number of workers or the engine.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from logging.handlers import QueueHandler
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any

from kb.core import signals, startup
from kb.core.arrow_without_pandas import without_pandas
from kb.core.context import Run
from kb.core.dask_engine import Pool, dask_executor
from kb.core.errors import FatalError, SettingError

LISTEN_S = 2.0  # for the last records of workers that have ended


class Inline(Executor):
    """Runs each task at once in this process: one worker, no pool to start."""

    window = 2

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A finished future with the result or the exception of the call."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001  whoever asks for the result gets it
            future.set_exception(error)
        return future


class Processes(ProcessPoolExecutor):
    """Worker processes of this machine. `window`: how many tasks keep them busy."""

    def __init__(self, workers: int) -> None:
        # spawn: DuckDB, Arrow and torch keep threads that a forked child would inherit broken.
        context = multiprocessing.get_context("spawn")
        self._records: Queue[Any] = context.Queue()
        self._records.cancel_join_thread()
        given = (self._records, logging.getLogger().level)
        super().__init__(workers, mp_context=context, initializer=_begin_worker, initargs=given)
        self.window = 2 * workers
        self._listener = threading.Thread(target=self._listen, name="log-of-workers", daemon=True)
        self._listener.start()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, and take in the last records of theirs."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._records.put(None)
        self._listener.join(LISTEN_S)  # a killed worker may have left half a record

    def _listen(self) -> None:
        """Log here what workers log."""
        while (record := self._records.get()) is not None:
            logging.getLogger(record.name).handle(record)


Workers = Inline | Processes | Pool


@contextlib.contextmanager
def executor_of(run: Run, size: int) -> Iterator[Workers]:
    """The executor of a command for tasks that read `size` bytes of files."""
    with executor_of_tasks(run, run.processes(size), run.root) as executor:
        yield executor


@contextlib.contextmanager
def executor_of_tasks(
    run: Run, count: int, writes: Path, reads: Sequence[Path] = ()
) -> Iterator[Workers]:
    """The executor of a command for `count` tasks of minutes each. The workers of a cluster must
    see the folder that tasks write to, and the places that they read.
    """
    most = run.workers if run.asked else None
    workers = min(run.workers, max(1, count))
    with make_executor(run.engine, workers, run.scheduler, writes, most, reads) as executor:
        yield executor


@contextlib.contextmanager
def make_executor(
    engine: str = "local",
    workers: int = 1,
    scheduler: str | None = None,
    root: Path | None = None,
    most: int | None = None,
    reads: Sequence[Path] = (),
) -> Iterator[Workers]:
    """The executor of `--engine`: "local" (this process or a pool) or "dask".

    For "dask" the tasks go to the cluster at `scheduler`, whose workers must see the data root
    (`root`, or another folder that tasks write to) and what the tasks read, at most `most` at once;
    or to one of `workers` processes on this machine.
    """
    without_pandas()  # `Inline` is a worker too
    if engine == "local":
        if workers <= 1:
            yield Inline()
            return
        with Processes(workers) as pool:
            try:
                yield pool
            except BrokenExecutor as error:
                raise FatalError(
                    "a worker process was killed, probably because memory ran out",
                    hint="try fewer --workers; the same command resumes",
                ) from error
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise
        return
    if engine == "dask":
        with dask_executor(scheduler, workers, root, most, reads) as cluster:
            yield cluster
        return
    raise SettingError(f"--engine is {engine!r}", hint="allowed: local, dask")


@contextlib.contextmanager
def make_threads(count: int) -> Iterator[Executor]:
    """Threads of this process, for work that lets others run, such as compressing and searching.

    After an error what has not begun is dropped.
    """
    with ThreadPoolExecutor(max(1, count)) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def map_in_order(
    executor: Executor, fn: Callable[..., Any], tasks: Iterable[tuple[Any, ...]], window: int = 4
) -> Iterator[Any]:
    """Results of `fn(*task)` in task order, with at most `window` tasks submitted at once.

    Memory is bounded by the window. Stops with Interrupted between tasks when asked to.
    """
    waiting: deque[Future[Any]] = deque()
    todo = iter(tasks)
    try:
        for task in todo:
            signals.stop.raise_if_asked()
            waiting.append(executor.submit(fn, *task))
            if len(waiting) >= window:
                yield waiting.popleft().result()
        while waiting:
            signals.stop.raise_if_asked()
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


def _begin_worker(records: "Queue[logging.LogRecord | None]", level: int) -> None:
    """Ctrl-C reaches the whole process group, but only the parent decides what it means; and a
    worker ends with it. It loads what its tasks use and no more, and sends what it logs to its
    parent by `records`.

    A worker holds both ends of its queue, so that the death of a killed parent never shows there.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    root = logging.getLogger()
    root.handlers[:] = [QueueHandler(records)]
    root.setLevel(level)
    startup.collect_seldom()
    without_pandas()
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, name="follow-parent", daemon=True).start()
