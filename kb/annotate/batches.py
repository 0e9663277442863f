"""Batches with little padding: windows of one padded length together, under a token budget.

Sorted by length, because a batch costs its longest window times its size. Each window is padded
to a fixed step above its own length, never to its neighbours' length: the numbers that the model
computes for it then don't depend on which other texts happened to be in the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

TOKEN_BUDGET = 1024  # tokens a batch, padding included; measured by tests/bench/bench_toxicity.py


def padded_length(length: int, size: int = 512) -> int:
    """`length` rounded up: to 4 tokens below 128, to 16 above; at most `size`.

    Half these steps save 3 % of the tokens and lose it again to smaller batches.
    """
    step = 4 if length <= 128 else 16
    return min(size, max(step, -(-length // step) * step))


def batches(
    lengths: Sequence[int], budget: int = TOKEN_BUDGET, size: int = 512
) -> Iterator[tuple[int, list[int]]]:
    """(padded length, numbers of the windows) of each batch, shortest first, in a fixed order.

    Every batch has at least one window, and no more tokens than `budget` when it has several.
    """
    waiting: list[int] = []
    width = 0
    for number in sorted(range(len(lengths)), key=lambda n: (lengths[n], n)):
        own = padded_length(lengths[number], size)
        if waiting and (own != width or own * (len(waiting) + 1) > budget):
            yield width, waiting
            waiting = []
        width = own
        waiting.append(number)
    if waiting:
        yield width, waiting
