"""The scores of a video's pairs, from stored vectors alone.

similarity      cosine of the clip's embedding and the text's
margin          how much higher that is than the mean with the texts of the video's other clips,
                those that do not overlap it
best_offset_s   by how much the picture comes after the words: of −8, −6, … 8 s the one at which the
                frames around the phrase are most similar to the text
static_share    of kb.score.figures

Vectors are stored in half precision, and scores are computed from what is stored, so a run without
the films gives the same scores to the last digit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from kb.core.installation import np
from kb.score.figures import figures_of
from kb.score.film_store import WINDOW_S, SeenFilm, Vectors, span
from kb.score.models import unit

OFFSETS_S = (0, -2, 2, -4, 4, -6, 6, -8, 8)  # of equals the first counts
AROUND_S = 1.0  # the frames around a phrase begin and end by as much before and after it
_DIGITS = 4

Row = dict[str, Any]


class Pooling(Protocol):
    """What makes one embedding of a clip of those of its frames."""

    step_s: float

    def clip(self, frames: np.ndarray) -> np.ndarray:
        """float32 [frames, width] → [width]."""


class PairScore(NamedTuple):
    """The score of a pair; the columns of schemas/tables/pairs/scores.toml."""

    pair_id: str
    similarity: float
    margin: float | None
    best_offset_s: float | None
    static_share: float | None
    frames: int


def needed_ticks(row: Row, step: float) -> np.ndarray:
    """The places on the grid of a film that vectors of a pair are kept of: those of its clip, and
    those around its phrase.
    """
    around = span(row["match_start_s"] - WINDOW_S, row["match_end_s"] + WINDOW_S, step)
    ticks = np.union1d(around, span(row["clip_start_s"], row["clip_end_s"], step))
    return ticks[ticks >= 0]


def scores_of(
    rows: Sequence[Row], seen: SeenFilm, vectors: Vectors, model: Pooling
) -> Iterator[PairScore]:
    """The scores of a video's pairs; a pair whose clip the film is too short for has none.

    `rows`: pair_id, text, clip_start_s, clip_end_s, match_start_s and match_end_s of pairs with a
    text.
    """
    step, there = model.step_s, vectors.frames.keys()
    starts = np.array([row["clip_start_s"] for row in rows])
    ends = np.array([row["clip_end_s"] for row in rows])
    texts = vectors.of_texts([row["text"] for row in rows])

    def frames_within(start_s: float, end_s: float) -> np.ndarray:
        """Vectors of these frames; none where the film has less than half of them."""
        asked = span(start_s, end_s, step).tolist()
        ticks = [tick for tick in asked if tick in there]
        return vectors.of_frames(ticks if 2 * len(ticks) >= len(asked) else ())

    for number, row in enumerate(rows):
        ticks = [
            tick
            for tick in span(starts[number], ends[number], step).tolist()
            if tick in there and (tick + 0.5) * step < seen.end_s
        ]
        if not ticks:
            continue
        frames = frames_within(starts[number], ends[number])
        if not len(frames):
            frames = vectors.of_frames(ticks)
        similar = texts @ unit(model.clip(frames))
        others = similar[(ends <= starts[number]) | (starts >= ends[number])]
        margin = float(similar[number] - others.mean()) if len(others) else None
        start_s, end_s = row["match_start_s"] - AROUND_S, row["match_end_s"] + AROUND_S
        windows = (frames_within(start_s + by, end_s + by) for by in OFFSETS_S)
        near = [float(texts[number] @ model.clip(x)) if len(x) else -np.inf for x in windows]
        best = int(np.argmax(np.round(near, _DIGITS)))
        yield PairScore(
            row["pair_id"],
            round(float(similar[number]), _DIGITS),
            None if margin is None else round(margin, _DIGITS),
            float(OFFSETS_S[best]) if np.isfinite(near[best]) else None,
            figures_of(row, seen).static_share,
            len(ticks),
        )
