"""Reddit in MineDojo's published layout: `reddit.json`, a list of objects with `id` and `type`.

Content is not in it: the published loader, and `kb reddit reconstruct`, bring it back by id. The
loader knows text, image, video and link and takes a post's content by its type; so a poll is a text
(as in the paper: its content is the post's own text), and a gallery an image (its content is the
gallery's address).
"""

from __future__ import annotations

import json
from typing import cast

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.verdict import Summary
from kb.store import parquet
from kb.store.atomic import writing
from kb.store.layout import Layout
from kb.store.reading import reading

# Types that MineDojo's loader does not know, and what they are there.
TYPES = {"poll": "text", "gallery": "image"}


def export(run: Run) -> Summary:
    """clean/reddit → export/minedojo/reddit.json, sorted by id.

    Raises FatalError without clean rows, DamagedData, DiskFull.
    """
    parts = manifest.rows(run.root, "reddit/posts")
    if not parts:
        raise FatalError(
            "nothing to export: clean/reddit has no posts", hint="run `kb reddit filter` first"
        )
    posts: list[tuple[str, str]] = []
    for part in parts:
        with reading([part]):
            rows = parquet.read_table(part, columns=["post_id", "type"])
        ids = cast("list[str]", rows["post_id"].to_pylist())
        types = cast("list[str]", rows["type"].to_pylist())
        posts += zip(ids, types, strict=True)
    path = Layout(run.root).export("minedojo", "reddit.json")
    with writing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write("[")
        for number, (key, kind) in enumerate(sorted(posts)):
            file.write(
                (",\n" if number else "\n") + json.dumps({"id": key, "type": TYPES.get(kind, kind)})
            )
        file.write("\n]\n")
    return Summary(posts=len(posts), path=str(path))
