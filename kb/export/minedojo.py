"""`--format minedojo`: YouTube, Reddit, pairs and tasks as in the published MineDojo data.

`export/minedojo/youtube_full.json` is a JSON list of `id, title, link, view_count, like_count,
duration` (seconds) `, fps`; `youtube_tutorial.json`, which its loader reads for `full=False`, has
of these the videos whose title says that it teaches.

`reddit.json` is a list of `id` and `type`. The published loader, and `kb reddit reconstruct`, bring
the content back by id. The loader knows text, image, video and link and takes a post's content by
its type; so a poll is a text (as in the paper: its content is the post's own text), and a gallery
an image (its content is the gallery's address).

`creative_tasks.yaml` is a mapping of `creative:<n>` to `collection, guidance, prompt` and `source`
with `youtube_id, start, end` in whole seconds, 0 and the video's length where the time is not
known. Guidance is null, as in the published tasks from YouTube.

`pairs.json` is `{keyword: [[video_id, start, end], …]}` (seconds), without text, a keyword a line.

All files are ASCII, as published. Source: "MineDojo: Building Open-Ended Embodied Agents with
Internet-Scale Knowledge" (NeurIPS 2022), data appendix. The wiki is in kb.export.minedojo_wiki.
"""

import json
import re
from pathlib import Path

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export.rows import check_rows, json_list, sorted_rows
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.tables import database
from kb.store.tables.reading import scan

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
# Types that MineDojo's loader does not know, and what they are there.
TYPES = {"poll": "text", "gallery": "image"}


def youtube(run: Run) -> Summary:
    """Writes both lists of videos, sorted by id. Raises FatalError without clean rows, DiskFull."""
    check_rows(run.root, "youtube/videos")
    path = Layout(run.root).export("minedojo", "youtube_full.json")
    count = 0
    with json_list(path) as add, json_list(path.with_name("youtube_tutorial.json")) as add_tutorial:
        for row in sorted_rows(run.root, "youtube/videos", list(YOUTUBE.values()), ["video_id"]):
            video = {name: row[ours] for name, ours in YOUTUBE.items()}
            add(video)
            if teaches(video["title"]):
                add_tutorial(video)
            count += 1
    return Summary(format="minedojo", videos=count, path=str(path))


def teaches(title: str) -> bool:
    """Whether a title says that the video is a tutorial."""
    return bool(_TEACHES.search(title))


def reddit(run: Run) -> Summary:
    """Writes the list of posts, sorted by id. Raises FatalError without clean rows, DamagedData,
    DiskFull.
    """
    check_rows(run.root, "reddit/posts")
    path = Layout(run.root).export("minedojo", "reddit.json")
    count = 0
    with json_list(path) as add:
        for row in sorted_rows(run.root, "reddit/posts", ["post_id", "type"], ["post_id"]):
            add({"id": row["post_id"], "type": TYPES.get(row["type"], row["type"])})
            count += 1
    return Summary(posts=count, path=str(path))


def pairs(run: Run) -> Path:
    """Writes the clips by keyword, which it holds in memory. Raises FatalError, DiskFull."""
    check_rows(run.root, "pairs/pairs")
    path = Layout(run.root).export("minedojo", "pairs.json")
    clips: dict[str, list[str]] = {}
    columns = ["keyword", "video_id", "clip_start_s", "clip_end_s"]
    for row in sorted_rows(run.root, "pairs/pairs", columns):
        clip = [row["video_id"], row["clip_start_s"], row["clip_end_s"]]
        clips.setdefault(row["keyword"], []).append(json.dumps(clip))
    lines = [f"{json.dumps(keyword)}: [{', '.join(clips[keyword])}]" for keyword in sorted(clips)]
    with writing(path) as temporary:
        body = ",\n".join(lines)
        temporary.write_text(f"{{\n{body}\n}}\n" if lines else "{\n}\n", encoding="ascii")
    return path


def tasks(run: Run) -> Path:
    """Writes the tasks, which MineDojo reads with OmegaConf. Raises FatalError, DiskFull."""
    check_rows(run.root, "tasks/tasks")
    path = Layout(run.root).export("minedojo", "creative_tasks.yaml")
    files = manifest.rows(run.root, "tasks/tasks"), manifest.rows(run.root, "youtube/videos")
    tasks, videos = map(scan, files)
    query = f"""SELECT prompt, video_id, coalesce(floor(start_s), 0)::INT,
        coalesce(ceil(end_s), duration_s, 0)::INT
        FROM {tasks} AS task LEFT JOIN {videos} AS video USING (video_id)
        ORDER BY video_id, task_id"""
    with writing(path) as temporary, temporary.open("w", encoding="ascii") as file:
        with database.over([*files[0], *files[1]], run.root) as con:
            rows = con.execute(query).fetchall()
        for number, (prompt, video_id, start, end) in enumerate(rows):
            # Strings of JSON are strings of YAML, whatever stands in them.
            file.write(
                f"creative:{number}:\n  collection: youtube\n  guidance: null\n"
                f"  prompt: {json.dumps(prompt)}\n  source:\n    end: {end}\n    start: {start}\n"
                f"    youtube_id: {json.dumps(video_id)}\n\n"
            )
    return path
