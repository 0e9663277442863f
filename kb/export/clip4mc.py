"""`kb pairs --format clip4mc`: the text pairs of CLIP4MC, in `export/clip4mc/`, a pair a line.

    dataset.json          every pair
    dataset_test.json     those of one video in twenty, by its id
    dataset_train.json    the others: no video is in both

A pair is `{"vid", "transcript clip", "size", "begin position", "end position"}`. Positions are the
clip's seconds in the video. `size` is a number for each of 16 frames: the target's share of the
frame, which CLIP4MC's tools get from the video itself. Nobody has seen a video here, so it is 1.0,
with which CLIP4MC weights no pair, until its tools fill it in. Files are ASCII.
Source: Jiang et al., "Reinforcement Learning Friendly Vision-Language Model for Minecraft" (2023).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.export.pair_rows import pair_rows
from kb.store.atomic import writing
from kb.store.layout import Layout

_FRAMES = 16
_ONE_IN = 20  # videos, for the test split
_COLUMNS = ["video_id", "text", "clip_start_s", "clip_end_s"]


def write(run: Run) -> Path:
    """Writes the files, row by row. Raises FatalError when pairs have no text, and DiskFull."""
    folder = Layout(run.root).export("clip4mc")
    path = folder / "dataset.json"
    with contextlib.ExitStack() as stack:
        whole, test, train = (
            stack.enter_context(_list(one))
            for one in (path, folder / "dataset_test.json", folder / "dataset_train.json")
        )
        for row in pair_rows(run, _COLUMNS):
            if row["text"] is None:
                raise FatalError(
                    "a pair has no text",
                    hint="run `kb pairs`, or `kb pairs --from-index FILE` with all transcripts",
                )
            pair = {
                "vid": row["video_id"],
                "transcript clip": row["text"],
                "size": [1.0] * _FRAMES,
                "begin position": row["clip_start_s"],
                "end position": row["clip_end_s"],
            }
            whole.add(pair)
            (test if in_test(row["video_id"]) else train).add(pair)
    return path


def in_test(video_id: str) -> bool:
    """Whether a video's pairs are in the test split: the same in every run and release."""
    digest = hashlib.sha256(video_id.encode()).digest()
    return int.from_bytes(digest[:8], "big") % _ONE_IN == 0


class _List:
    """A JSON list that is written an item a line."""

    def __init__(self, file: IO[str]) -> None:
        self._file, self._count = file, 0

    def add(self, item: dict[str, Any]) -> None:
        """Write one more item."""
        self._file.write((",\n" if self._count else "\n") + json.dumps(item))
        self._count += 1


@contextlib.contextmanager
def _list(path: Path) -> Iterator[_List]:
    """A list that appears at `path` whole or not at all."""
    with writing(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write("[")
        yield _List(file)
        file.write("\n]\n")
