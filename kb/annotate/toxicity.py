"""Scores texts that have none yet, and looks scores up. Score and decision are apart.

    scorer = ToxicityScorer.open(run, "youtube")       exit 2 without model or extra
    scorer.annotate(batches of texts)          scores each distinct text once, resumable
    scorer.lookup(text_hashes(texts))          the scores of a column of texts

Equal texts are scored once, by their hash, in this run and in all later ones, and also where they
belong to several sources, each of which keeps a copy of the score. A reduced precision is only used
when asked for; a score within its reach of the threshold is computed again in fp32.

Texts are scored and written in chunks. A chunk is what a stop waits for and what is lost at worst,
so it takes some seconds, whatever the model; large ones are scored faster, because texts of one
length share a batch. What a text scores doesn't depend on its chunk.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.annotate.backends import REACH, check_options, choose_device, open_runner, prepare
from kb.annotate.scores import (
    CATEGORIES,
    PRECISIONS,
    Scores,
    text_hashes,
    to_score,
    unscored,
)
from kb.artifacts import manifest, score_files
from kb.artifacts.freshness import MODEL
from kb.core import clock, signals
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import DamagedData, LimitReached, MissingExtra, MissingModel
from kb.core.sources import SOURCES
from kb.store.checkpoint import Checkpoint, find_checkpoint, need_extra
from kb.store.layout import Layout, parquet_files

CHUNK_TEXTS, CHUNK_CHARACTERS = 1024, 1_000_000  # the largest chunk
FIRST, SMALLEST = 32, 128  # the first chunk, and a slow model's, is this part of it
CHUNK_S = 5.0  # about what a chunk takes
LOOKUP_TEXTS, LOOKUP_CHARACTERS = (
    100_000,
    50_000_000,
)  # what is looked up at once, because each look-up reads all scores

HAND_S = 10.0  # a chunk that takes longer ends between two batches when the run was asked to stop
_ONE = threading.Lock()  # one chunk at a time in a process


@dataclass(frozen=True)
class AnnotationCounts:
    """What `annotate` did, in texts; equal ones that come near each other count once."""

    texts: int = 0
    scored: int = 0
    known: int = 0
    exact_again: int = 0  # reduced scores near the threshold, computed again in fp32


@dataclass(frozen=True)
class ToxicityScorer:
    """Toxicity of one source's texts. Off when the profile says so: every score is then null."""

    run: Run
    source: str
    checkpoint: Checkpoint | None
    precision: str = "fp32"
    device: str = "auto"
    threshold: float | None = None
    least: str | None = None  # scores of a lower precision are computed again
    scores: Scores | None = field(default=None)

    @classmethod
    def open(
        cls, run: Run, source: str, precision: str | None = None, device: str = "auto"
    ) -> ToxicityScorer:
        """Check model, extra, precision and device without loading the model.

        A `precision` that is asked for is the least that a score must have; without one fp32 scores
        what has no score, and what there is stays.
        Raises MissingExtra, MissingModel, SettingError: all exit 2, before anything is written.
        """
        check_options(precision or "fp32", device, here=run.engine == "local")
        toxicity = run.profile.toxicity
        if not toxicity.on:
            return cls(run, source, None)
        need_extra()
        checkpoint = find_checkpoint(run.settings)
        scores = Scores(
            str(Layout(run.root).annotations(source)), checkpoint.model, checkpoint.revision
        )
        return cls(
            run,
            source,
            checkpoint,
            precision or "fp32",
            device,
            toxicity.threshold(source),
            precision,
            scores,
        )

    @property
    def on(self) -> bool:
        return self.checkpoint is not None

    def lookup(self, hashes: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Table:
        """`CATEGORIES` and `precision` of each hash, in order; null where there is none."""
        return unscored(len(hashes)) if self.scores is None else self.scores.lookup(hashes)

    def annotate(
        self, batches: Iterable[Any], part: tuple[int, int] | None = None
    ) -> AnnotationCounts:
        """Score what has no score yet, of batches of texts (Arrow columns or lists; null and "" are
        passed over). `part`: (2, 4) for the second of four parts of them, by their hashes.

        Each finished chunk is on disk before the next one is begun. Raises LimitReached (`--limit`
        new texts), Interrupted, DiskFull: the next call goes on there.
        """
        if self.checkpoint is None or self.scores is None:
            return AnnotationCounts()
        with self.run.progress.task(f"toxicity {self.source}", unit="texts") as task:
            counts = self._annotate(batches, task, part or (1, 1))
        folder = Path(self.scores.folder)
        if parquet_files(folder, score_files.PARTS):
            score_files.unite(folder)
        return counts

    def _annotate(
        self, batches: Iterable[Any], task: Any, part: tuple[int, int]
    ) -> AnnotationCounts:
        assert self.scores is not None
        rule = ScoreRule(self.threshold, self.least, self.precision)
        chunks = Chunks(self.scores, rule, self.run.limit, task, part, self._of_other_sources())
        assert self.checkpoint is not None
        local = self.run.engine == "local"
        threads = self.run.workers if local else 0
        job = ScoringJob(self.checkpoint, self.precision, self.device, threads, self.threshold)
        # On one machine the threads are inside the model: one copy of it, whatever the number of
        # cores.
        if not local and job.device != "cuda" and job.precision != "bf16":
            prepare(job.checkpoint)  # once here, not by every worker at the same time
        run, most = self.run, self.run.workers if self.run.asked else None
        count = 1 if local else run.workers
        with make_executor(run.engine, count, run.scheduler, run.root, most) as executor:
            waiting: list[list[str]] = []

            def tasks() -> Iterable[tuple[Any, ...]]:
                for hashes, texts in chunks.of(batches):
                    waiting.append(hashes)
                    yield job, texts

            scored = exact = 0
            for result in map_in_order(
                executor, score_chunk, tasks(), 1 if local else executor.window + 2
            ):
                hashes = waiting.pop(0)
                self.scores.write(hashes, result["scores"], result["precisions"], result["classes"])
                chunks.written(hashes)
                chunks.took(result["seconds"])
                scored, exact = scored + len(hashes), exact + result["again"]
                task.advance(
                    len(hashes), tokens_per_s=round(result["tokens"] / max(result["seconds"], 1e-9))
                )
                signals.stop.raise_if_asked()
        if chunks.limited:
            raise LimitReached(
                f"--limit: {scored} texts scored", hint="run the same command to resume"
            )
        return AnnotationCounts(chunks.texts, scored, chunks.texts - scored, exact)

    def _of_other_sources(self) -> list[Scores]:
        assert self.scores is not None
        layout = Layout(self.run.root)
        folders = [layout.annotations(name) for name in SOURCES if name != self.source]
        return [replace(self.scores, folder=str(each)) for each in folders if each.is_dir()]


def model_key(run: Run, source: str) -> str:
    """Exit 2 now, before anything is written, when texts can't be scored; else the model's key for
    `scores`. Without a model it is that of the stored scores, where there are some.

    The key is "" when the profile switches toxicity off.
    """
    try:
        checkpoint = ToxicityScorer.open(run, source).checkpoint
    except (MissingExtra, MissingModel):
        if key := stored(run.root, source):
            return key
        raise
    return f"{checkpoint.model}@{checkpoint.revision}" if checkpoint else ""


def stored(root: Path, source: str) -> str:
    """The key of the model whose scores decided in clean/<source>, else of the one that has most
    scores; "" where there are none.
    """
    made = manifest.read_manifest(root, f"clean/{source}")
    if made is not None and (key := made.settings.get(MODEL)):
        return str(key)
    return Scores(str(Layout(root).annotations(source)), "", "").most_used()


def annotate(run: Run, source: str, texts: Iterable[Any]) -> AnnotationCounts:
    """Score what has no score yet of the batches `texts`, each distinct text once. Without a model
    every text must have a stored score.

    See `ToxicityScorer`.
    """
    try:
        scorer = ToxicityScorer.open(run, source)
    except (MissingExtra, MissingModel):
        model, _, revision = stored(run.root, source).rpartition("@")
        scores = Scores(str(Layout(run.root).annotations(source)), model, revision)
        for batch in texts:
            if pc.any(scores.missing(text_hashes(batch))).as_py():
                raise  # a text without a score
        return AnnotationCounts()
    return scorer.annotate(texts)


def scores(
    key: str, root: Path | str, source: str, texts: pa.Array[Any] | pa.ChunkedArray[Any]
) -> pa.Table:
    """`CATEGORIES` (float32) of each text, null for null or empty ones and for what is no class of
    the model. For workers.

    Loads no model.

    `key` is what `check` gave.
    """
    if not key:
        return unscored(len(texts)).select(CATEGORIES)
    model, _, revision = key.rpartition("@")
    known = Scores(str(Layout(Path(root)).annotations(source)), model, revision)
    return known.lookup(text_hashes(texts)).select(CATEGORIES)


class ScoreRule(NamedTuple):
    """Which stored scores count: those of this source that have at least the precision `least`, and
    those of others that have `precision`; of both no reduced one near `threshold`.
    """

    threshold: float | None = None
    least: str | None = None
    precision: str = PRECISIONS[0]


class Chunks:
    """Distinct unscored texts in the order they come, in memory that the number of texts doesn't
    change.

    What has a score is asked for a look-up at a time, and added here where only `others` have it;
    what was given out is remembered until `written`.
    `texts`: how many came by, equal ones of one look-up counted once.
    """

    def __init__(
        self,
        scores: Scores,
        rule: ScoreRule,
        limit: int | None,
        task: Any,
        part: tuple[int, int] = (1, 1),
        others: Sequence[Scores] = (),
    ) -> None:
        self._scores, self._rule, self._limit, self._task = scores, rule, limit, task
        self._others, (self._number, self._parts) = others, part
        self._given: set[str] = set()
        self._part = FIRST
        self.texts = 0
        self.limited = False

    def of(self, batches: Iterable[Any]) -> Iterable[tuple[list[str], list[str]]]:
        """(hashes, texts) of each chunk; `limited` is set when more were there than the limit
        allows.
        """
        hashes: list[str] = []
        texts: list[str] = []
        size = given = 0
        for key, text in self._unscored(batches):
            if self._limit is not None and given == self._limit:
                self.limited = True
                break
            hashes.append(key)
            texts.append(text)
            size, given = size + len(text), given + 1
            if len(texts) * self._part >= CHUNK_TEXTS or size * self._part >= CHUNK_CHARACTERS:
                yield hashes, texts
                hashes, texts, size = [], [], 0
        if texts:
            yield hashes, texts

    def written(self, hashes: Iterable[str]) -> None:
        """Their scores are on disk, where the next look-up finds them."""
        self._given.difference_update(hashes)

    def took(self, seconds: float) -> None:
        """How long a chunk took: the next ones are twice or half as large when it was far from
        `CHUNK_S`.
        """
        if seconds < CHUNK_S / 2:
            self._part = max(1, self._part // 2)
        elif seconds > 2 * CHUNK_S:
            self._part = min(SMALLEST, self._part * 2)

    def _unscored(self, batches: Iterable[Any]) -> Iterable[tuple[str, str]]:
        for texts in self._lookups(batches):
            self.texts += len(texts)
            missing = cast("list[bool]", self._missing(pa.array(texts, pa.string())).to_pylist())
            self._task.advance(len(missing) - sum(missing))
            for (key, text), wanted in zip(texts.items(), missing, strict=True):
                if not wanted:
                    continue
                if key in self._given:
                    self._task.advance(1)
                    continue
                self._given.add(key)
                yield key, text

    def _missing(self, hashes: pa.Array[Any]) -> pa.Array[Any]:
        """True for each hash to be scored, after what other sources have was added."""
        rule = self._rule
        wanted = to_score(self._scores.lookup(hashes), rule.threshold, REACH, rule.least)
        for other in self._others:
            if not len(lacking := hashes.filter(wanted)):
                break
            try:
                known = other.lookup(lacking)
            except (DamagedData, FileNotFoundError):
                # Damaged, which its own commands tell, or just united by a run of its own.
                continue
            fit = pc.invert(to_score(known, rule.threshold, REACH, rule.precision))
            if len(there := lacking.filter(fit)):
                self._scores.add_part(there, known.filter(fit))
                wanted = pc.and_(wanted, pc.invert(pc.is_in(hashes, value_set=there)))
        return wanted

    def _lookups(self, batches: Iterable[Any]) -> Iterable[dict[str, str]]:
        """Texts that are not empty by their hashes, as many as are looked up at once."""
        texts: dict[str, str] = {}
        size = 0
        for batch in batches:
            column = (
                batch
                if isinstance(batch, (pa.Array, pa.ChunkedArray))
                else pa.array(batch, pa.string())
            )
            for key, text in zip(text_hashes(column).to_pylist(), column.to_pylist(), strict=True):
                if key is None or text is None or key in texts:
                    continue
                if int(key[:16], 16) % self._parts != self._number - 1:
                    continue
                texts[key] = text
                size += len(text)
                if len(texts) == LOOKUP_TEXTS or size >= LOOKUP_CHARACTERS:
                    yield texts
                    texts, size = {}, 0
        if texts:
            yield texts


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

    Near the threshold a reduced score is made exact.
    """
    # A Dask worker with several threads takes several chunks: one at a time, with all threads.
    with _ONE:
        job = job._replace(threads=job.threads or _worker_threads())
        job = job._replace(device=_device(job.device, job.precision))
        runner = _runner(job.checkpoint, job.precision, job.device, job.threads)
        start, before = clock.monotonic(), runner.tokens

        def between() -> None:
            # A chunk of some seconds is finished; one long text may take minutes.
            if clock.monotonic() - start > HAND_S:
                signals.stop.raise_if_asked()

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


# Kept by a worker for its next tasks.
_device, _runner = cache(choose_device), cache(open_runner)
