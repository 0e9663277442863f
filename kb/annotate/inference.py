"""Texts to toxicity scores with one network: tokens, windows, batches, largest score, rounding.

*Windows.* BERT reads 512 tokens at once, its two special tokens included. Detoxify drops the rest;
here the rest is scored in consecutive windows, and a text has the largest score of its windows. The
first window is exactly what Detoxify would score.

*Batches.* Windows are sorted by length, because a batch costs its longest window times its size.
Each window is padded to a fixed step above its own length and never to its neighbours' length, so
its numbers do not depend on the other texts of the run.

*Rounding.* The same network gives other last bits with another instruction set, number of threads,
runtime or batch shape. Measured on BERT-base with random weights (logits from -7 to 9), with torch,
ONNX Runtime and OpenVINO in fp32, the least and the widest instruction sets, one and two threads,
no logit differed by more than 2.3e-5 from float64 and no score by more than 4e-6. Scores are
therefore rounded to four decimals. Windows whose score lies within `ERROR` of a rounding boundary
are computed again in float64, where machines differ by about 1e-13. These are few, because scores
near 0 and 1 move little with their logit. Reduced precisions are rounded and not computed again:
a processor without VNNI gives other int8 scores (all of 120 texts at BERT's size, by up to 0.04).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

import msgspec

from kb.annotate.detoxify_model import WINDOW
from kb.core.errors import MissingModel

DECIMALS = 4  # the schemas declare it as the unit of every score
ERROR = 1e-4  # of a logit in fp32; four times the largest measured difference
TOKEN_BUDGET = 1024  # tokens per batch, padding included; measured by tests/bench/bench_toxicity.py


class Meta(msgspec.Struct, frozen=True):
    """What inference needs to know about a model besides its weights."""

    classes: tuple[str, ...]
    prefix: tuple[int, ...]  # special tokens before each window
    suffix: tuple[int, ...]  # special tokens after each window
    pad: int
    window: int

    @classmethod
    def of(cls, detoxify: Any) -> Meta:
        """Read it from a loaded Detoxify object. Raises MissingModel."""
        tokenizer = detoxify.tokenizer
        bare = len(tokenizer("", add_special_tokens=False)["input_ids"])
        marks = tokenizer("")["input_ids"]
        if bare or len(marks) != 2:
            raise MissingModel(
                f"the model's tokenizer adds {len(marks)} special tokens to a text;"
                " one before and one after are supported",
                hint="`kb models fetch` lists supported models",
            )
        return cls(
            tuple(detoxify.class_names),
            tuple(marks[:1]),
            tuple(marks[1:]),
            tokenizer.pad_token_id,
            min(WINDOW, tokenizer.model_max_length),
        )


class ModelNetwork(Protocol):
    """A forward pass: two int64 arrays of shape (windows, tokens) give logits (windows, outputs).

    The first outputs are the classes. A model may have more, which Detoxify does not read.
    """

    def __call__(self, ids: Any, mask: Any) -> Any: ...


class Runner:
    """Scores texts with one network. Not thread-safe.

    `exact` loads the same network in float64, for windows near a rounding boundary.
    """

    def __init__(
        self,
        name: str,
        network: ModelNetwork,
        tokenizer: Any,
        meta: Meta,
        budget: int = TOKEN_BUDGET,
        exact: Callable[[], ModelNetwork] | None = None,
    ) -> None:
        self.name, self.meta, self.budget = name, meta, budget
        self.tokens = 0  # scored so far, without padding
        self.exactly = 0  # windows computed again in float64
        self._network, self._tokenizer, self._exact = network, tokenizer, exact

    def score(
        self, texts: Sequence[str], between: Callable[[], None] = lambda: None
    ) -> list[list[float]]:
        """One row of scores per text, in the order of `meta.classes`; each between 0 and 1.

        Calls `between` before each batch; an exception from it ends the work.
        """
        import numpy as np

        if not texts:
            return []
        inputs: list[Sequence[int]] = []
        owners: list[int] = []
        marks = len(self.meta.prefix) + len(self.meta.suffix)
        for number, encoded in enumerate(
            self._tokenizer.encode_batch(list(texts), add_special_tokens=False)
        ):
            for window in windows(encoded.ids, self.meta.window, marks):
                inputs.append([*self.meta.prefix, *window, *self.meta.suffix])
                owners.append(number)
        logits = self._logits(self._network, inputs, between)
        self.tokens += sum(map(len, inputs))
        near = near_boundary(logits) if self._exact else ()
        if len(near) and self._exact:
            self.exactly += len(near)
            logits[near] = self._logits(self._exact(), [inputs[n] for n in near], between)
        return largest(np.round(_sigmoid(logits), DECIMALS).tolist(), owners, len(texts))

    def _logits(
        self, network: ModelNetwork, inputs: Sequence[Sequence[int]], between: Callable[[], None]
    ) -> Any:
        """Logits (windows, classes) in float64, in the order of `inputs`."""
        import numpy as np

        logits = np.empty((len(inputs), len(self.meta.classes)))
        for width, numbers in batches(
            [len(window) for window in inputs], self.budget, self.meta.window
        ):
            between()
            ids = np.full((len(numbers), width), self.meta.pad, dtype=np.int64)
            mask = np.zeros((len(numbers), width), dtype=np.int64)
            for row, number in enumerate(numbers):
                window = inputs[number]
                ids[row, : len(window)] = window
                mask[row, : len(window)] = 1
            logits[numbers] = np.asarray(network(ids, mask))[:, : len(self.meta.classes)]
        return logits


def windows(ids: Sequence[int], size: int = 512, marks: int = 2) -> list[Sequence[int]]:
    """Consecutive slices of at most `size - marks` tokens; one empty slice for no tokens."""
    step = size - marks
    if len(ids) <= step:
        return [ids]
    return [ids[start : start + step] for start in range(0, len(ids), step)]


def largest(
    scores: Sequence[Sequence[float]], owners: Sequence[int], texts: int
) -> list[list[float]]:
    """The largest score of each category over the windows of each text.

    `scores` has one row per window, `owners` the number of its text (0 … texts - 1).
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


def padded_length(length: int, size: int = 512) -> int:
    """`length` rounded up to a multiple of 4 below 128 and of 16 above; at most `size`.

    Half these steps save 3 % of the tokens and lose it again to smaller batches.
    """
    step = 4 if length <= 128 else 16
    return min(size, max(step, -(-length // step) * step))


def batches(
    lengths: Sequence[int], budget: int = TOKEN_BUDGET, size: int = 512
) -> Iterator[tuple[int, list[int]]]:
    """(padded length, numbers of the windows) of each batch, shortest first, in a fixed order.

    Each batch has at least one window, and at most `budget` tokens if it has several.
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


def near_boundary(logits: Any) -> Any:
    """The numbers of the rows of logits (windows, classes) that another machine may round
    differently.
    """
    import numpy as np

    scores = _sigmoid(logits)
    steps = scores * 10**DECIMALS
    to_tie = np.abs(steps - np.floor(steps) - 0.5)
    # A score moves by its slope, p (1 - p), times the change of its logit.
    reach = ERROR * scores * (1.0 - scores) * 10**DECIMALS
    return np.flatnonzero((to_tie <= reach).any(axis=1))


def _sigmoid(logits: Any) -> Any:
    import numpy as np

    return 1.0 / (1.0 + np.exp(-np.asarray(logits, dtype=np.float64)))
