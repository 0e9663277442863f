"""`kb pairs --format minedojo`: MineDojo's pairs, `{keyword: [[video_id, start, end], …]}`
(seconds), without text.

Source: MineDojo (NeurIPS 2022), data appendix. `export/minedojo/pairs.json`, a keyword a line,
in ASCII as published.
"""

from __future__ import annotations

import json
from pathlib import Path

from kb.core.context import Run
from kb.export.pair_rows import pair_rows
from kb.store.atomic import writing
from kb.store.layout import Layout

_COLUMNS = ["keyword", "video_id", "clip_start_s", "clip_end_s"]


def write(run: Run) -> Path:
    """Writes the file. Holds the clips in memory (the layout is sorted by keyword). Raises
    FatalError, DiskFull.
    """
    path = Layout(run.root).export("minedojo", "pairs.json")
    clips: dict[str, list[str]] = {}
    for row in pair_rows(run, _COLUMNS):
        keyword, *clip = row.values()
        clips.setdefault(keyword, []).append(json.dumps(clip))
    with writing(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write("{")
        for number, keyword in enumerate(sorted(clips)):
            comma = ",\n" if number else "\n"
            file.write(f"{comma}{json.dumps(keyword)}: [{', '.join(clips[keyword])}]")
        file.write("\n}\n")
    return path
