"""Texts to scores with one network: tokens, windows, batches, one pass a batch, the largest window.

Every score is rounded here and nowhere else (kb/annotate/rounding.py).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from kb.annotate import rounding
from kb.annotate.batches import TOKEN_BUDGET, batches
from kb.annotate.detoxify_model import WINDOW
from kb.annotate.windows import largest, windows
from kb.core.errors import MissingModel


@dataclass(frozen=True)
class Meta:
    """What a runner must know about the model besides its weights."""

    classes: tuple[str, ...]
    prefix: tuple[int, ...]  # marks before a window's tokens
    suffix: tuple[int, ...]  # and after them
    pad: int
    window: int

    @classmethod
    def of(cls, detoxify: Any) -> Meta:
        """Read from a loaded Detoxify object."""
        tokenizer = detoxify.tokenizer
        bare = len(tokenizer("", add_special_tokens=False)["input_ids"])
        marks = tokenizer("")["input_ids"]
        if bare or len(marks) != 2:
            raise MissingModel(
                f"the model's tokenizer puts {len(marks)} marks around a text;"
                " models with one before and one after it are known",
                hint="see `kb models fetch` for models that are",
            )
        return cls(
            tuple(detoxify.class_names),
            tuple(marks[:1]),
            tuple(marks[1:]),
            tokenizer.pad_token_id,
            min(WINDOW, tokenizer.model_max_length),
        )

    @classmethod
    def read(cls, path: Path) -> Meta:
        data = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            tuple(data["classes"]),
            tuple(data["prefix"]),
            tuple(data["suffix"]),
            data["pad"],
            data["window"],
        )


class ModelNetwork(Protocol):
    """One pass: two int64 arrays of the same shape (windows, tokens) give logits (windows,
    outputs).

    The first outputs are the classes; a model may have more, which Detoxify doesn't read.
    """

    def __call__(self, ids: Any, mask: Any) -> Any: ...


class Runner:
    """Scores texts with one network. Not for several threads at once.

    `exact` makes the same network in float64, for windows on the edge between two rounded scores;
    without it they stay as they are.
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
        self.tokens = 0  # scored so far, padding left out
        self.exactly = 0  # windows computed again in float64
        self._network, self._tokenizer, self._exact = network, tokenizer, exact

    def score(
        self, texts: Sequence[str], between: Callable[[], None] = lambda: None
    ) -> list[list[float]]:
        """One row of scores a text, in the order of `meta.classes`; each between 0 and 1.

        `between` is called between two batches; what it raises ends the work.
        """
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
        again = rounding.undecided(logits) if self._exact else ()
        if len(again) and self._exact:
            self.exactly += len(again)
            logits[again] = self._logits(self._exact(), [inputs[n] for n in again], between)
        return largest(rounding.rounded(logits).tolist(), owners, len(texts))

    def _logits(
        self, network: ModelNetwork, inputs: Sequence[Sequence[int]], between: Callable[[], None]
    ) -> Any:
        """Logits (windows, classes) in float64, in the order of the windows `inputs`."""
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
