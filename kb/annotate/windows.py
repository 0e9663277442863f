"""Long texts as windows that the model can read; a text's score is the largest of its windows.

BERT reads 512 tokens at once, its two marks included. Detoxify cuts the rest off; here the rest
is scored too, in consecutive windows, so that an insult at the end of a long text is found.
The first window is exactly what Detoxify would have scored.
"""

from __future__ import annotations

from collections.abc import Sequence


def windows(ids: Sequence[int], size: int = 512, marks: int = 2) -> list[Sequence[int]]:
    """Consecutive slices of at most `size - marks` tokens; one empty slice for no tokens."""
    step = size - marks
    if len(ids) <= step:
        return [ids]
    return [ids[start : start + step] for start in range(0, len(ids), step)]


def largest(
    scores: Sequence[Sequence[float]], owners: Sequence[int], texts: int
) -> list[list[float]]:
    """The largest score of each category over each text's windows.

    `scores` has one row a window, `owners` the number of its text (0 … texts - 1).
    """
    best: list[list[float] | None] = [None] * texts
    for row, owner in zip(scores, owners, strict=True):
        before = best[owner]
        best[owner] = (
            list(row) if before is None else [max(a, b) for a, b in zip(before, row, strict=True)]
        )
    if any(row is None for row in best):
        raise ValueError("a text has no window")
    return best  # type: ignore[return-value]
