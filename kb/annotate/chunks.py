"""Texts that have no score yet, each once, in chunks that are scored and written as one.

A chunk is what a stop waits for and what is lost at worst, so it takes some seconds, whatever the
model; large ones are scored faster, because texts of one length share a batch. What a text scores
doesn't depend on its chunk.
"""

from collections.abc import Iterable
from typing import Any, cast

import pyarrow as pa

from kb.annotate.backends import REACH
from kb.annotate.scores import Scores, text_hashes

CHUNK_TEXTS, CHUNK_CHARACTERS = 1024, 1_000_000  # the largest chunk
FIRST, SMALLEST = 32, 128  # the first chunk, and a slow model's, is this part of it
CHUNK_S = 5.0  # about what a chunk takes
LOOKUP_TEXTS, LOOKUP_CHARACTERS = (
    100_000,
    50_000_000,
)  # what is looked up at once, because each look-up reads all scores


class Chunks:
    """Distinct unscored texts in the order they come, in memory that the number of texts doesn't
    change.

    What has a score is asked for a look-up at a time; what was given out is remembered until
    `written`.
    `texts`: how many came by, equal ones of one look-up counted once.
    """

    def __init__(
        self,
        scores: Scores,
        threshold: float | None,
        limit: int | None,
        task: Any,
        least: str | None = None,
    ) -> None:
        self._scores, self._threshold, self._limit, self._task = scores, threshold, limit, task
        self._least = least
        self._given: set[str] = set()
        self._part = FIRST
        self.texts = 0
        self.limited = False

    def of(self, batches: Iterable[Any]) -> Iterable[tuple[list[str], list[str]]]:
        """(hashes, texts) of each chunk; `limited` is set when more were there than the limit
        allows.
        """
        hashes: list[str] = []
        texts: list[str] = []
        size = given = 0
        for key, text in self._unscored(batches):
            if self._limit is not None and given == self._limit:
                self.limited = True
                break
            hashes.append(key)
            texts.append(text)
            size, given = size + len(text), given + 1
            if len(texts) * self._part >= CHUNK_TEXTS or size * self._part >= CHUNK_CHARACTERS:
                yield hashes, texts
                hashes, texts, size = [], [], 0
        if texts:
            yield hashes, texts

    def written(self, hashes: Iterable[str]) -> None:
        """Their scores are on disk, where the next look-up finds them."""
        self._given.difference_update(hashes)

    def took(self, seconds: float) -> None:
        """How long a chunk took: the next ones are twice or half as large when it was far from
        `CHUNK_S`.
        """
        if seconds < CHUNK_S / 2:
            self._part = max(1, self._part // 2)
        elif seconds > 2 * CHUNK_S:
            self._part = min(SMALLEST, self._part * 2)

    def _unscored(self, batches: Iterable[Any]) -> Iterable[tuple[str, str]]:
        for texts in self._lookups(batches):
            self.texts += len(texts)
            hashes = pa.array(texts, pa.string())
            missing = cast(
                "list[bool]",
                self._scores.missing(hashes, self._threshold, REACH, self._least).to_pylist(),
            )
            self._task.advance(len(missing) - sum(missing))
            for (key, text), wanted in zip(texts.items(), missing, strict=True):
                if not wanted:
                    continue
                if key in self._given:
                    self._task.advance(1)
                    continue
                self._given.add(key)
                yield key, text

    def _lookups(self, batches: Iterable[Any]) -> Iterable[dict[str, str]]:
        """Texts that are not empty by their hashes, as many as are looked up at once."""
        texts: dict[str, str] = {}
        size = 0
        for batch in batches:
            column = (
                batch
                if isinstance(batch, (pa.Array, pa.ChunkedArray))
                else pa.array(batch, pa.string())
            )
            for key, text in zip(text_hashes(column).to_pylist(), column.to_pylist(), strict=True):
                if key is None or text is None or key in texts:
                    continue
                texts[key] = text
                size += len(text)
                if len(texts) == LOOKUP_TEXTS or size >= LOOKUP_CHARACTERS:
                    yield texts
                    texts, size = {}, 0
        if texts:
            yield texts
