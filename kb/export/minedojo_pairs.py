"""`kb pairs --format minedojo`: MineDojo's pairs, `{keyword: [[video_id, start, end], …]}`
(seconds), without text.

Source: MineDojo (NeurIPS 2022), data appendix. `export/minedojo/pairs.json`, a keyword a line.
"""

from __future__ import annotations

from pathlib import Path

import orjson

from kb.core.context import Run
from kb.export.pair_rows import pair_rows
from kb.store.atomic import writing
from kb.store.layout import Layout

_COLUMNS = ["keyword", "video_id", "clip_start_s", "clip_end_s"]


def write(run: Run) -> Path:
    """Writes the file. Holds the clips in memory (the layout is sorted by keyword).

    Raises FatalError, DiskFull.
    """
    path = Layout(run.root).export("minedojo", "pairs.json")
    clips: dict[str, list[bytes]] = {}
    for row in pair_rows(run, _COLUMNS):
        keyword, *clip = row.values()
        clips.setdefault(keyword, []).append(orjson.dumps(clip))
    with writing(path) as temporary, temporary.open("wb") as file:
        file.write(b"{")
        for number, keyword in enumerate(sorted(clips)):
            file.write(
                (b",\n" if number else b"\n")
                + orjson.dumps(keyword)
                + b": ["
                + b", ".join(clips[keyword])
                + b"]"
            )
        file.write(b"\n}\n")
    return path
