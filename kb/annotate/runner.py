"""Texts to scores with one network: tokens, windows, batches, one pass a batch, the largest window.

Scores are rounded to five decimals: far below what they mean, and far above the last bits in which
machines and backends differ.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from kb.annotate.batches import TOKEN_BUDGET, batches
from kb.annotate.detoxify_model import WINDOW
from kb.annotate.windows import largest, windows
from kb.core.errors import MissingModel

DECIMALS = 5


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
                f"the model's tokenizer puts {len(marks)} marks around a text; models with one before and one after it are known",
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


class Network(Protocol):
    """One pass: two int64 arrays of the same shape (windows, tokens) give logits (windows, outputs).

    The first outputs are the classes; a model may have more, which Detoxify doesn't read.
    """

    def __call__(self, ids: Any, mask: Any) -> Any: ...


class Runner:
    """Scores texts with one network. Not for several threads at once."""

    def __init__(
        self, name: str, network: Network, tokenizer: Any, meta: Meta, budget: int = TOKEN_BUDGET
    ) -> None:
        self.name, self.meta, self.budget = name, meta, budget
        self.tokens = 0  # scored so far, padding left out
        self._network, self._tokenizer = network, tokenizer

    def score(
        self, texts: Sequence[str], between: Callable[[], None] = lambda: None
    ) -> list[list[float]]:
        """One row of scores a text, in the order of `meta.classes`; each between 0 and 1.

        `between` is called between two batches; what it raises ends the work.
        """
        import numpy as np

        if not texts:
            return []
        found: list[Sequence[int]] = []
        owners: list[int] = []
        marks = len(self.meta.prefix) + len(self.meta.suffix)
        for number, encoded in enumerate(
            self._tokenizer.encode_batch(list(texts), add_special_tokens=False)
        ):
            for window in windows(encoded.ids, self.meta.window, marks):
                found.append([*self.meta.prefix, *window, *self.meta.suffix])
                owners.append(number)
        scores = np.empty((len(found), len(self.meta.classes)))
        for width, numbers in batches(
            [len(window) for window in found], self.budget, self.meta.window
        ):
            between()
            ids = np.full((len(numbers), width), self.meta.pad, dtype=np.int64)
            mask = np.zeros((len(numbers), width), dtype=np.int64)
            for row, number in enumerate(numbers):
                window = found[number]
                ids[row, : len(window)] = window
                mask[row, : len(window)] = 1
            logits = np.asarray(self._network(ids, mask), dtype=np.float64)[
                :, : len(self.meta.classes)
            ]
            scores[numbers] = 1.0 / (1.0 + np.exp(-logits))
            self.tokens += int(mask.sum())
        return largest(np.round(scores, DECIMALS).tolist(), owners, len(texts))
