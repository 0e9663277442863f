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

import hashlib
from pathlib import Path

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.export.rows import check_rows, json_list, sorted_rows
from kb.store.layout import Layout

_FRAMES = 16
_ONE_IN = 20  # videos, for the test split
_COLUMNS = ["video_id", "text", "clip_start_s", "clip_end_s"]


def write(run: Run) -> Path:
    """Writes the files, row by row. Raises FatalError when pairs have no text, and DiskFull."""
    check_rows(run.root, "pairs/pairs")
    folder = Layout(run.root).export("clip4mc")
    path = folder / "dataset.json"
    with (
        json_list(path) as add,
        json_list(folder / "dataset_test.json") as add_test,
        json_list(folder / "dataset_train.json") as add_train,
    ):
        for row in sorted_rows(run.root, "pairs/pairs", _COLUMNS):
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
            add(pair)
            (add_test if in_test(row["video_id"]) else add_train)(pair)
    return path


def in_test(video_id: str) -> bool:
    """Whether a video's pairs are in the test split: the same in every run and release."""
    digest = hashlib.sha256(video_id.encode()).digest()
    return int.from_bytes(digest[:8], "big") % _ONE_IN == 0
