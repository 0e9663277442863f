"""The section "scores" of pairs/measures.json: what scores are like, and what people say of them.

Of the pairs that people judged (`visible`: whether the clip shows what the text names), in ten bins
of equal size by similarity: the share that shows it, with its 95 % interval; how well similarity
tells the two apart (area under the curve); and from which similarity on the share is as high as the
profile wants. Without judgements nothing of that is known, and no threshold is shipped.

The MineDojo paper compares its model with people by F1: K-means with K = 2 over the scores of
judged clips, where a score above the middle of the two means counts as a yes (Fan et al.,
"MineDojo", 2022, evaluation of Creative tasks). In one dimension the best two clusters are found
exactly. F1 is 2p / (1 + p), where p is the share of yes by both among the clips with a yes by the
score or by people, so the ends of p's interval give those of F1.

Source of the interval of the area: Hanley and McNeil, Radiology 143 (1982).
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import table_catalog
from kb.artifacts.measures import QUANTILES, quantiles_of
from kb.core.config.profile import Profile
from kb.core.installation import np
from kb.core.summary import share_of
from kb.store.tables import database
from kb.store.tables.reading import scan

SECTION = "scores"
_BINS = 10
_LEAST = 20  # judged pairs from which on a threshold is proposed
_SQL = """
SELECT item_id, avg((answer = 'yes')::INT) FROM {labels}
WHERE kind = 'pair' AND question = '{question}' AND answer IN ('yes', 'no')
GROUP BY item_id HAVING avg((answer = 'yes')::INT) <> 0.5"""  # a tie says nothing


def section(root: Path, profile: Profile, scores: pa.Table) -> dict[str, Any]:
    """The section of scored pairs (pairs/scores). Raises DamagedData."""
    figures = {name: _quantiles(scores[name]) for name in ("similarity", "margin", "static_share")}
    offsets = scores["best_offset_s"].drop_null()
    moved = int((np.abs(offsets.to_numpy()) > 2).sum())
    models = scores["model"].unique().to_pylist()
    return {
        "models": models,
        "pairs": scores.num_rows,
        **figures,
        "further_than_2_s": share_of(moved, len(offsets)),
        "visible": _calibrated(root, scores, profile.score.wanted_precision),
    }


def _quantiles(column: pa.ChunkedArray[Any]) -> dict[str, Any]:
    values = column.drop_null().to_numpy()
    values_there = np.quantile(values, QUANTILES).round(4).tolist() if len(values) else ()
    return quantiles_of(len(values), values_there)


def _calibrated(root: Path, scores: pa.Table, wanted: float) -> dict[str, Any]:
    """What judgements say of similarities; {"judged": 0} without any."""
    answers = judgements(root, "visible")
    judged = scores.filter(pc.is_in(scores["pair_id"], pa.array(list(answers), pa.string())))
    both = sorted(
        (row["similarity"], answers[row["pair_id"]])
        for row in judged.select(["pair_id", "similarity"]).to_pylist()
    )
    if not both:
        return {"judged": 0}
    score, seen = (np.array(values) for values in zip(*both, strict=True))
    ends = np.linspace(0, len(score), min(_BINS, len(score)) + 1).astype(int).tolist()
    bins = [
        {
            "from": float(score[start]),
            "to": float(score[end - 1]),
            **share_of(int(seen[start:end].sum()), end - start),
        }
        for start, end in pairwise(ends)
    ]
    return {
        "judged": len(score),
        "bins": bins,
        "auc": area(score[seen], score[~seen]),
        "wanted_precision": wanted,
        "reached_from": _reached(score, seen, wanted),
        "f1": f1_of_clusters(score, seen),
    }


def judgements(root: Path, question: str) -> dict[str, bool]:
    """What most people answered to a question about pairs, by the pair's id. Raises DamagedData."""
    files = table_catalog.read_catalog(root).files("labels/labels")
    if not files:
        return {}
    with database.connect(root) as con:
        answers = con.sql(_SQL.format(labels=scan(files), question=question)).fetchall()
    return {pair_id: share > 0.5 for pair_id, share in answers}


def area(right: np.ndarray, wrong: np.ndarray) -> dict[str, Any] | None:
    """The area under the curve with its 95 % interval: how often a right pair has the higher score,
    ties counted half. None without both kinds.
    """
    n, m = len(right), len(wrong)
    if not n or not m:
        return None
    ordered = np.sort(wrong)
    below = np.searchsorted(ordered, right, "left") + np.searchsorted(ordered, right, "right")
    share = float(below.sum() / (2 * n * m))
    first, second = share / (2 - share), 2 * share**2 / (1 + share)
    variance = share * (1 - share) + (n - 1) * (first - share**2) + (m - 1) * (second - share**2)
    half = 1.959964 * (max(variance, 0.0) / (n * m)) ** 0.5
    return {
        "auc": round(share, 4),
        "low": round(max(0.0, share - half), 4),
        "high": round(min(1.0, share + half), 4),
        "right": n,
        "wrong": m,
    }


def f1_of_clusters(scores: np.ndarray, visible: np.ndarray) -> dict[str, Any] | None:
    """F1 as the paper counts it, with its 95 % interval. None where all scores are equal."""
    ordered = np.sort(scores.astype(np.float64))
    count, sums = np.arange(1, len(ordered)), np.cumsum(ordered)
    ends = np.flatnonzero(np.diff(ordered)) if len(ordered) else count  # equals stay together
    if not len(ends):
        return None
    low = sums[ends] / count[ends]
    high = (sums[-1] - sums[ends]) / (len(ordered) - count[ends])
    apart = count[ends] * (len(ordered) - count[ends]) * (high - low) ** 2
    best = int(np.argmax(apart))
    boundary = float((low[best] + high[best]) / 2)
    right = scores > boundary
    both, either = int((right & visible).sum()), int((right | visible).sum())
    shared = share_of(both, either)
    f1 = {name: round(2 * shared[name] / (1 + shared[name]), 4) for name in ("low", "high")}
    return {
        "f1": round(2 * both / (both + either), 4),
        **f1,
        "n": len(scores),
        "boundary": round(boundary, 4),
    }


def _reached(score: np.ndarray, seen: np.ndarray, wanted: float) -> dict[str, Any] | None:
    """The lowest similarity from which on at least the wanted share of the judged pairs shows what
    is named, with that share; None where there is none, or too few were judged to say so.
    """
    for start in range(len(score) - _LEAST + 1):
        if seen[start:].mean() > wanted and (not start or score[start] > score[start - 1]):
            share = share_of(int(seen[start:].sum()), len(score) - start)
            return {"similarity": float(score[start]), **share}
    return None
