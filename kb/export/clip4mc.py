"""`kb pairs --format clip4mc`: the text pairs of CLIP4MC, `export/clip4mc/dataset.json`, a pair a
line.

A pair is `{"vid", "transcript clip", "size", "begin position", "end position"}`. Positions are the
clip's seconds in the video. `size` is a number for each of 16 frames: the target's share of the
frame, which CLIP4MC gets from the video itself. Nobody has seen a video here, so it is 1.0, the
whole frame, until the tools of CLIP4MC fill it in.
Source: Jiang et al., "Reinforcement Learning Friendly Vision-Language Model for Minecraft" (2023).
"""

from __future__ import annotations

from pathlib import Path

import orjson

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.export.pair_rows import pair_rows
from kb.store.atomic import writing
from kb.store.layout import Layout

_FRAMES = 16
_COLUMNS = ["video_id", "text", "clip_start_s", "clip_end_s"]


def write(run: Run) -> Path:
    """Writes the file, row by row. Raises FatalError when pairs have no text, and DiskFull."""
    path = Layout(run.root).export("clip4mc", "dataset.json")
    count = 0
    with writing(path) as temporary, temporary.open("wb") as file:
        file.write(b"[")
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
            file.write((b",\n" if count else b"\n") + orjson.dumps(pair))
            count += 1
        file.write(b"\n]\n")
    return path
