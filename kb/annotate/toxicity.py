"""Scores texts that have none yet, and looks scores up. Score and decision are apart.

    scorer = Scorer.open(run, "youtube")       exit 2 without model or extra: nothing is written
    scorer.annotate(batches of texts)          scores each distinct text once, resumable
    scorer.columns(texts, "toxicity_title")    the table columns of a text column

Equal texts are scored once, by their hash, in this run and in all later ones. A reduced precision
is only used when asked for; a score within its reach of the threshold is computed again in fp32.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.annotate.backends import check_options, prepare
from kb.annotate.chunks import Chunks
from kb.annotate.scores import CATEGORIES, Scores, text_hashes, unscored
from kb.annotate.verified_checkpoint import Checkpoint, find_checkpoint, need_extra
from kb.annotate.worker import ScoringJob, score_chunk
from kb.core import signals
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import LimitReached
from kb.store.layout import Layout


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

    def columns(
        self,
        texts: pa.Array[Any] | pa.ChunkedArray[Any],
        prefix: str = "toxicity",
        categories: bool = True,
    ) -> dict[str, pa.ChunkedArray[Any]]:
        """The largest category as `prefix`,
        and with `categories` each one as `prefix_<category>`.
        """
        scores = self.lookup(text_hashes(texts))
        columns = {prefix: pc.max_element_wise(*(scores[name] for name in CATEGORIES))}
        if categories:
            columns |= {f"{prefix}_{name}": scores[name] for name in CATEGORIES}
        return columns

    def annotate(self, batches: Iterable[Any]) -> AnnotationCounts:
        """Score what has no score yet, of batches of texts (Arrow columns or lists; null and "" are
        passed over).

        Each finished chunk is on disk before the next one is begun. Raises LimitReached (`--limit`
        new texts), Interrupted, DiskFull: the next call goes on there.
        """
        if self.checkpoint is None or self.scores is None:
            return AnnotationCounts()
        with self.run.progress.task(f"toxicity {self.source}", unit="texts") as task:
            counts = self._annotate(batches, task)
        if any(Path(self.scores.folder).glob("part-*.parquet")):
            self.scores.merge()
        return counts

    def _annotate(self, batches: Iterable[Any], task: Any) -> AnnotationCounts:
        assert self.scores is not None
        chunks = Chunks(self.scores, self.threshold, self.run.limit, task, self.least)
        assert self.checkpoint is not None
        job = ScoringJob(
            self.checkpoint, self.precision, self.device, self._threads(), self.threshold
        )
        local = self.run.engine == "local"
        # On one machine the threads are inside the model: one copy of it, whatever the number of
        # cores.
        if not local and job.device != "cuda" and job.precision != "bf16":
            prepare(job.checkpoint)  # once here, not by every worker at the same time
        with make_executor(
            self.run.engine, 1 if local else self.run.workers, self.run.scheduler
        ) as executor:
            waiting: list[list[str]] = []

            def tasks() -> Iterable[tuple[Any, ...]]:
                for hashes, texts in chunks.of(batches):
                    waiting.append(hashes)
                    yield job, texts

            scored = exact = 0
            for result in map_in_order(
                executor, score_chunk, tasks(), 1 if local else 2 * self.run.workers + 2
            ):
                hashes = waiting.pop(0)
                self.scores.write(hashes, result["scores"], result["precisions"], result["classes"])
                chunks.written(hashes)
                chunks.took(result["seconds"])
                scored, exact = scored + len(hashes), exact + result["again"]
                task.advance(
                    len(hashes), tokens_per_s=round(result["tokens"] / max(result["seconds"], 1e-9))
                )
                signals.stop.check()
        if chunks.limited:
            raise LimitReached(
                f"--limit: {scored} texts scored", hint="run the same command to resume"
            )
        return AnnotationCounts(chunks.texts, scored, chunks.texts - scored, exact)

    def _threads(self) -> int:
        return self.run.workers if self.run.engine == "local" else 0


def check(run: Run, source: str) -> str:
    """Exit 2 now, before anything is written, when texts can't be scored; else the model's key for
    `scores`.

    The key is "" when the profile switches toxicity off.
    """
    checkpoint = ToxicityScorer.open(run, source).checkpoint
    return f"{checkpoint.model}@{checkpoint.revision}" if checkpoint else ""


def annotate(
    run: Run, source: str, texts: Iterable[Any], precision: str | None = None, device: str = "auto"
) -> AnnotationCounts:
    """Score what has no score yet of the batches `texts`, each distinct text once.

    See `ToxicityScorer`.
    """
    return ToxicityScorer.open(run, source, precision, device).annotate(texts)


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
