"""Where in its film the text of a pair is shown, and whether at all, from stored vectors alone.

z(t)        similarity (cosine) of the text with the frame at t, less the mean of the same text over
            all stored frames of the film, divided by their standard deviation
smoothed    the mean of z over 3 s
window      as long as the clip, moved by up to 20 s within the film. The best one has the highest
            mean of smoothed z, in which a frame weighs the less the further it is from the middle,
            so that what is shown for a moment comes to lie there; of equals the one moved least.
            One of which less than half is stored does not count.
peak        the highest smoothed z in the best window
alignable   1 / (1 + exp(−slope · (peak − middle))), by [score] align_slope and align_middle

Without a frame's vector, a text's, or a difference between the film's frames nothing is known.

That a text has one best place near its words, or none, and that the similarity along the film tells
which, is of Han, Xie and Zisserman, "Temporal Alignment Networks for Long-term Video" (CVPR 2022),
who train for it on narrated videos; here the model is the user's CLIP. The two numbers are fitted
as by Platt, "Probabilistic Outputs for Support Vector Machines" (1999).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts.measures import QUANTILES, quantiles_of
from kb.clips.clip_files import Row
from kb.core.context import Run
from kb.core.installation import np
from kb.core.summary import share_of
from kb.score.calibration import judgements
from kb.score.film_store import (
    WINDOW_S,
    SeenFilm,
    Vectors,
    chosen_model,
    span,
    text_key,
    vectors_of,
)
from kb.score.models import unit

SECTION = "alignment"
SPOKEN, ALIGNED = "visible", "visible_aligned"  # the questions about clips at either times
LEAST = 20  # judged pairs from which on the curve is fitted
LIKELY = 0.5
_SMOOTHED_S = 3.0
_LEAST_SPREAD = 1e-6  # of similarities: below it all frames look the same
_TEXTS = 64  # whose similarities are in memory together
_DIGITS = 4


class AlignedTimes(NamedTuple):
    """When the text of a pair is shown, as far as the film tells, and the peak there."""

    start_s: float
    end_s: float
    peak: float


class Aligner(NamedTuple):
    """Aligned times by a model's vectors, and the curve from peak to probability."""

    root: Path
    model: str
    middle: float
    slope: float

    def times(self, rows: Sequence[Row], seen: SeenFilm) -> dict[str, AlignedTimes]:
        """Those of a video's pairs that can be told, by the pair's id. `rows`: pair_id, text,
        clip_start_s and clip_end_s. Raises DamagedData.
        """
        vectors = vectors_of(self.root, rows[0]["video_id"], self.model)
        return aligned_times(rows, seen.end_s, vectors) if vectors.film == seen.film else {}

    def columns(self, rows: Sequence[Row], seen: SeenFilm) -> dict[str, dict[str, float]]:
        """The columns of films/film_figures, by the pair's id."""
        return {
            pair_id: {
                "aligned_start_s": times.start_s,
                "aligned_end_s": times.end_s,
                "alignable": self.alignable(times.peak),
            }
            for pair_id, times in self.times(rows, seen).items()
        }

    def alignable(self, peak: float) -> float:
        """How probable it is that the film shows the text near its words."""
        return round(float(_logistic(self.slope * (peak - self.middle))), _DIGITS)


def aligner(run: Run, model: str = "") -> Aligner | None:
    """By this model, or by the one that pairs were aligned by; None where they were not."""
    model = model or chosen_model(run.root, SECTION)
    score = run.profile.score
    return Aligner(run.root, model, score.align_middle, score.align_slope) if model else None


def aligned_times(rows: Sequence[Row], end_s: float, vectors: Vectors) -> dict[str, AlignedTimes]:
    """As `Aligner.times`, for a film that ends at `end_s`."""
    ticks = np.array(sorted(vectors.frames), np.int64)
    known = [row for row in rows if row["text"] and text_key(row["text"]) in vectors.texts]
    texts = list(dict.fromkeys(row["text"] for row in known))
    frames = unit(vectors.of_frames(ticks.tolist()).astype(np.float64))
    found: dict[str, AlignedTimes] = {}
    for at in range(0, len(texts) if len(ticks) else 0, _TEXTS):
        some = texts[at : at + _TEXTS]
        similar = unit(vectors.of_texts(some).astype(np.float64)) @ frames.T
        z = similar - similar.mean(axis=1, keepdims=True)
        spread = similar.std(axis=1, keepdims=True)
        z /= np.where(spread < _LEAST_SPREAD, np.nan, spread)
        of_text = dict(zip(some, z, strict=True))
        for row in known:
            if row["text"] in of_text:
                times = _best(row, end_s, ticks, of_text[row["text"]], vectors.step_s)
                if times is not None:
                    found[row["pair_id"]] = times
    return found


def _best(
    row: Row, end_s: float, ticks: np.ndarray, z: np.ndarray, step: float
) -> AlignedTimes | None:
    """The best window of a clip. `ticks`: the places of the stored frames; `z`: of each of them."""
    start, end = row["clip_start_s"], row["clip_end_s"]
    clip = span(start, end, step)
    most, reach = round(WINDOW_S / step), int(np.ceil(_SMOOTHED_S / 2 / step)) - 1
    first, count = int(clip[0]) - most - reach, len(clip) + 2 * (most + reach)
    near = slice(*np.searchsorted(ticks, (first, first + count)).tolist())
    values, there = np.zeros(count), np.zeros(count)
    values[ticks[near] - first], there[ticks[near] - first] = z[near], 1
    kernel = np.ones(2 * reach + 1)
    counted = np.maximum(np.convolve(there, kernel, "valid"), 1)
    smoothed = np.convolve(values, kernel, "valid") / counted
    there = there[reach : count - reach]
    smoothed = np.where(there > 0, smoothed, 0)
    weight = 1 - np.abs((clip + 0.5) * step - (start + end) / 2) / ((end - start) / 2 + step)
    shown = np.correlate(there, weight, "valid")  # of each window, how much of it is stored
    worth = np.correlate(smoothed, weight, "valid") / np.maximum(shown, 1e-9)
    by = np.arange(-most, most + 1)
    fits = (2 * shown >= weight.sum()) & (start + by * step >= 0) & (end + by * step <= end_s)
    worth = np.where(fits & np.isfinite(worth), worth.round(_DIGITS), -np.inf)
    best = int(np.lexsort((by, np.abs(by), -worth))[0])
    if not np.isfinite(worth[best]):
        return None
    inside = slice(best, best + len(clip))
    peak = smoothed[inside][there[inside] > 0].max()
    moved = float(by[best] * step)
    return AlignedTimes(round(start + moved, 6), round(end + moved, 6), round(float(peak), _DIGITS))


def fitted(peaks: np.ndarray, shown: np.ndarray) -> tuple[float, float] | None:
    """(middle, slope) of the curve that fits best to whether a clip shows its text (bool [pairs]);
    None where that does not grow with the peak.
    """
    n, m = int(shown.sum()), int((~shown).sum())
    wanted = np.where(shown, (n + 1) / (n + 2), 1 / (m + 2))  # so that no slope is infinite
    design = np.stack([peaks, np.ones(len(peaks))], axis=1)
    numbers = np.zeros(2)
    for _ in range(100):
        guess = _logistic(design @ numbers)
        curvature = (design.T * (guess * (1 - guess))) @ design + 1e-9 * np.eye(2)
        step = np.linalg.solve(curvature, design.T @ (wanted - guess))
        numbers = numbers + step * min(1.0, 2 / max(float(np.abs(step).max()), 1e-12))
        if np.abs(step).max() < 1e-9:
            break
    slope, offset = numbers.tolist()
    return (round(-offset / slope, _DIGITS), round(slope, _DIGITS)) if slope > 0 else None


def section(root: Path, model: str, figures: pa.Table) -> dict[str, Any]:
    """What the aligned times of all pairs (films/film_figures) are like, and what people who looked
    at clips at spoken and at aligned times say.
    """
    rows = [row for row in figures.to_pylist() if row["alignable"] is not None]
    values = np.array([row["alignable"] for row in rows])
    answers = {question: judgements(root, question) for question in (SPOKEN, ALIGNED)}
    return {
        "model": model,
        "pairs": len(rows),
        "unknown": figures.num_rows - len(rows),
        "alignable": quantiles_of(
            len(rows), np.quantile(values, QUANTILES).round(4).tolist() if rows else ()
        ),
        "likely": share_of(int((values >= LIKELY).sum()), len(rows)),
        "visible": [_visible(rows, answers, least) for least in (0.0, LIKELY)],
    }


def _visible(
    rows: Sequence[Row], answers: Mapping[str, Mapping[str, bool]], least: float
) -> dict[str, Any]:
    """Of the judged pairs that are alignable at least so much, the share that shows its text."""
    chosen = [row["pair_id"] for row in rows if row["alignable"] >= least]
    of_each = {
        name: [answers[question][pair] for pair in chosen if pair in answers[question]]
        for name, question in (("spoken", SPOKEN), ("aligned", ALIGNED))
    }
    shares = {name: share_of(sum(given), len(given)) for name, given in of_each.items()}
    return {"alignable_from": least, **shares}


def _logistic(values: Any) -> Any:
    return 1 / (1 + np.exp(-np.clip(values, -500, 500)))
