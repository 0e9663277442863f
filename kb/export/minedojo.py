"""`--format minedojo`: YouTube in the layout of the published MineDojo data, a drop-in replacement.

`export/minedojo/youtube_full.json` is a JSON list of `id, title, link, view_count, like_count,
duration` (seconds) `, fps`; `youtube_tutorial.json`, which its loader reads for `full=False`, has
of these the videos whose title says that it teaches. Both are ASCII, as published. Source:
"MineDojo: Building Open-Ended Embodied Agents with Internet-Scale Knowledge" (NeurIPS 2022), data
appendix. The other sources' layouts are in files beside this one.
"""

from __future__ import annotations

import contextlib
import json
import re

from kb.artifacts import manifest
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


# MineDojo chose its tutorials by playlists; a title is what there is of every video.
_TEACHES = re.compile(
    r"\b(tutorials?|guides?|walk-?throughs?|how to|beginners?|basics|step by step|lessons?|"
    r"explained|tips)\b",
    re.IGNORECASE,
)


def youtube(run: Run) -> Summary:
    """Writes both files from clean/youtube/videos, one video a line, sorted by id.

    Memory is bounded by the rows read ahead. Raises FatalError without clean rows, and DiskFull.
    """
    parts = manifest.rows(run.root, "youtube/videos")
    if not parts:
        raise FatalError(
            "nothing to export: clean/youtube/videos has no rows",
            hint="run `kb youtube filter` first",
        )
    path = Layout(run.root).export("minedojo", "youtube_full.json")
    count, teaching = 0, 0
    merge = Merge(parts, ["video_id"], list(YOUTUBE.values()))
    with (
        contextlib.closing(merge),
        writing(path) as whole,
        writing(path.with_name("youtube_tutorial.json")) as some,
        whole.open("w", encoding="ascii") as every,
        some.open("w", encoding="ascii") as tutorials,
    ):
        every.write("[")
        tutorials.write("[")
        for rows in merge:
            for row in rows.rename_columns(list(YOUTUBE)).to_pylist():
                line = json.dumps(row)
                every.write((",\n" if count else "\n") + line)
                count += 1
                if teaches(row["title"]):
                    tutorials.write((",\n" if teaching else "\n") + line)
                    teaching += 1
        every.write("\n]\n")
        tutorials.write("\n]\n")
    return Summary(format="minedojo", videos=count, path=str(path))


def teaches(title: str) -> bool:
    """Whether a title says that the video is a tutorial."""
    return bool(_TEACHES.search(title))
