"""What a worker does: score one chunk with a model that it loads once and keeps."""

import threading
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from kb.annotate.backends import REACH, choose_device, open_runner
from kb.annotate.detoxify_model import explained_memory
from kb.annotate.inference import Runner
from kb.annotate.verified_checkpoint import Checkpoint
from kb.core import clock, signals

HAND_S = 10.0  # a chunk that takes longer ends between two batches when the run was asked to stop
_ONE = threading.Lock()  # one chunk at a time in a process


class ScoringJob(NamedTuple):
    """How a worker is to score; what it loads is kept for the next task.

    `threads` 0: as many as the worker has. `device` "auto" is the worker's own GPU, where it has
    one.
    """

    checkpoint: Checkpoint
    precision: str
    device: str
    threads: int
    threshold: float | None


def score_chunk(job: ScoringJob, texts: Sequence[str]) -> dict[str, Any]:
    """Scores of a chunk, in its order; runs in a worker.

    Near the threshold a reduced score is made exact. Raises FatalError when memory is too short.
    """
    # A Dask worker with several threads takes several chunks: one at a time, with all threads.
    with _ONE, explained_memory():
        return _score_chunk(job._replace(threads=job.threads or _worker_threads()), texts)


def _score_chunk(job: ScoringJob, texts: Sequence[str]) -> dict[str, Any]:
    job = job._replace(device=_device(job.device, job.precision))
    runner = _runner(job.checkpoint, job.precision, job.device, job.threads)
    start, before = clock.monotonic(), runner.tokens

    def between() -> None:
        # A chunk of some seconds is finished; one long text may take minutes.
        if clock.monotonic() - start > HAND_S:
            signals.stop.check()

    scores = runner.score(texts, between)
    precisions = [job.precision] * len(texts)
    near = []
    if job.threshold is not None and REACH[job.precision]:
        near = [
            n
            for n, row in enumerate(scores)
            if abs(max(row) - job.threshold) <= REACH[job.precision]
        ]
        exact = (
            _runner(job.checkpoint, "fp32", job.device, job.threads).score(
                [texts[n] for n in near], between
            )
            if near
            else []
        )
        for n, row in zip(near, exact, strict=True):
            scores[n], precisions[n] = row, "fp32"
    return {
        "scores": scores,
        "precisions": precisions,
        "classes": runner.meta.classes,
        "again": len(near),
        "tokens": runner.tokens - before,
        "seconds": clock.monotonic() - start,
    }


def _worker_threads() -> int:
    """Threads of the Dask worker that this runs on."""
    from distributed import get_worker

    try:
        return get_worker().state.nthreads
    except ValueError:  # not on a worker
        return 1


@cache
def _device(wanted: str, precision: str) -> str:
    return choose_device(wanted, precision)


@cache
def _runner(checkpoint: Checkpoint, precision: str, device: str, threads: int) -> Runner:
    return open_runner(checkpoint, precision, device, threads)
