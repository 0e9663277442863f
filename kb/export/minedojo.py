"""`--format minedojo`: YouTube in the layout of the published MineDojo data, a drop-in replacement.

`export/minedojo/youtube_full.json` is a JSON list of `id, title, link, view_count, like_count,
duration` (seconds) `, fps`. Source: "MineDojo: Building Open-Ended Embodied Agents with
Internet-Scale Knowledge" (NeurIPS 2022), data appendix. The other sources' layouts are in files
beside this one.
"""

from __future__ import annotations

import orjson

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.verdict import Summary
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.merge import Merge

# MineDojo's name ← ours, in the published order
YOUTUBE = {
    "id": "video_id",
    "title": "title",
    "link": "link",
    "view_count": "view_count",
    "like_count": "like_count",
    "duration": "duration_s",
    "fps": "fps",
}


def youtube(run: Run) -> Summary:
    """Writes youtube_full.json from clean/youtube/videos, one video a line, sorted by id.

    Memory is bounded by the rows read ahead. Raises FatalError without clean rows, and DiskFull.
    """
    parts = Layout(run.root).rows("youtube/videos")
    if not parts:
        raise FatalError(
            "nothing to export: clean/youtube/videos has no rows",
            hint="run `kb youtube filter` first",
        )
    path = Layout(run.root).export("minedojo", "youtube_full.json")
    count = 0
    merge = Merge(parts, ["video_id"], list(YOUTUBE.values()))
    try:
        with writing(path) as temporary, temporary.open("wb") as file:
            file.write(b"[")
            for rows in merge:
                for row in rows.rename_columns(list(YOUTUBE)).to_pylist():
                    file.write((b",\n" if count else b"\n") + orjson.dumps(row))
                    count += 1
            file.write(b"\n]\n")
    finally:
        merge.close()
    return Summary(
        command="youtube export", source="youtube", format="minedojo", videos=count, path=str(path)
    )
