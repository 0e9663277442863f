"""A film and the pairs of its video → a score for each pair.

Frames are taken on one grid of the whole film, so that clips that overlap share decoding and
embedding. What is measured of a pair:

similarity      cosine of the clip's embedding and the text's
margin          how much higher that is than the mean with the texts of the video's other clips,
                those that do not overlap it
best_offset_s   by how much the picture comes after the words: of −8, −6, … 8 s the one at which the
                frames around the phrase are most similar to the text
static_share    share of neighbouring frames of the clip that hardly differ
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.clips.frames import frames_at
from kb.core import signals
from kb.core.installation import np
from kb.score.models import BATCH, ClipModel, unit

OFFSETS_S = (0, -2, 2, -4, 4, -6, 6, -8, 8)  # of equals the first counts
AROUND_S = 1.0  # the frames around a phrase begin and end by as much before and after it
STILL = 2.0  # neighbouring frames hardly differ when their values (0 to 255) do by less on average
_DIGITS = 4

Row = dict[str, Any]


class PairScore(NamedTuple):
    """The score of a pair; the columns of schemas/tables/pairs/scores.toml."""

    pair_id: str
    similarity: float
    margin: float | None
    best_offset_s: float | None
    static_share: float | None
    frames: int


def scores_of(path: Path, rows: Sequence[Row], model: ClipModel) -> Iterator[PairScore]:
    """The scores of a video's pairs; a pair whose clip the film is too short for has none.

    `rows`: pair_id, text, clip_start_s, clip_end_s, match_start_s and match_end_s of pairs with a
    text. Raises UndecodableVideo, Interrupted.
    """
    step = model.step_s
    clips = [_ticks(row["clip_start_s"], row["clip_end_s"], step) for row in rows]
    phrases = [
        [
            _ticks(row["match_start_s"] - AROUND_S + by, row["match_end_s"] + AROUND_S + by, step)
            for by in OFFSETS_S
        ]
        for row in rows
    ]
    wanted = np.unique(np.concatenate([*clips, *(one for some in phrases for one in some)]))
    wanted = wanted[wanted >= 0]
    embedded, still = _watched(path, wanted, model)
    there = wanted[: len(embedded)]  # the film may end before

    def seen(ticks: np.ndarray) -> np.ndarray:
        """The embeddings of these frames; none where the film has less than half of them."""
        ticks, asked = ticks[np.isin(ticks, there)], len(ticks)
        return embedded[np.searchsorted(there, ticks if 2 * len(ticks) >= asked else ticks[:0])]

    clips = [ticks[np.isin(ticks, there)] for ticks in clips]
    scored = [number for number, ticks in enumerate(clips) if len(ticks)]
    texts = model.texts([row["text"] for row in rows])
    of_clips = {number: unit(model.clip(seen(clips[number]))) for number in scored}
    starts = np.array([row["clip_start_s"] for row in rows])
    ends = np.array([row["clip_end_s"] for row in rows])
    for number in scored:
        similar = texts @ of_clips[number]
        others = similar[(ends <= starts[number]) | (starts >= ends[number])]
        margin = float(similar[number] - others.mean()) if len(others) else None
        near = [
            float(texts[number] @ model.clip(frames)) if len(frames) else -np.inf
            for frames in map(seen, phrases[number])
        ]
        best = int(np.argmax(np.round(near, _DIGITS)))
        ticks = clips[number][:-1][np.diff(clips[number]) == 1]
        yield PairScore(
            rows[number]["pair_id"],
            round(float(similar[number]), _DIGITS),
            None if margin is None else round(margin, _DIGITS),
            float(OFFSETS_S[best]) if np.isfinite(near[best]) else None,
            round(float(still[np.searchsorted(there, ticks)].mean()), _DIGITS)
            if len(ticks)
            else None,
            len(clips[number]),
        )


def _ticks(start_s: float, end_s: float, step: float) -> np.ndarray:
    """The places on the grid of a film, (tick + ½) · step, that lie in a span; one at least."""
    first = round(np.ceil(start_s / step - 0.5))
    return np.arange(first, max(first, round(np.floor(end_s / step - 0.5))) + 1)


def _watched(path: Path, ticks: np.ndarray, model: ClipModel) -> tuple[np.ndarray, np.ndarray]:
    """Embeddings of the frames at these places of the grid, as far as the film goes; and of each
    whether the next one, a step later, hardly differs.
    """
    times = ((ticks + 0.5) * model.step_s).tolist()
    embedded = [model.frames(())]
    still = np.zeros(len(ticks), bool)
    batch: list[np.ndarray] = []
    before: np.ndarray | None = None
    for number, image in enumerate(frames_at(path, times, model.size, model.fit)):
        if before is not None:
            apart = np.abs(image.astype(np.int16) - before).mean()
            still[number - 1] = apart < STILL
        before = image.astype(np.int16)
        batch.append(image)
        if len(batch) == BATCH:
            signals.stop.check()
            embedded.append(model.frames(batch))
            batch = []
    embedded.append(model.frames(batch))
    return np.concatenate(embedded), still
