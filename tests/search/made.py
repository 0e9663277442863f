"""A small clean world with one right place for each question, and near misses all around it.

Every action goes with every animal, once in each source: a question's other places have one of its
words, or both in different places.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.schema import table
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table

ANIMALS = ("wolf", "parrot", "axolotl", "panda", "camel", "llama")
ACTIONS = ("tame", "feed", "ride", "breed", "trap")
ITEMS = ("bones", "seeds", "fish", "bamboo", "cactus", "wheat")
FILLER = "so welcome back to the series and thank you all for watching"
START = datetime(2023, 1, 1, tzinfo=UTC)
SECRET = "zyxomma"  # stands in each source's first place


def combinations() -> Iterator[tuple[int, str, str]]:
    """(number, action, animal)."""
    pairs = [(action, animal) for animal in ANIMALS for action in ACTIONS]
    yield from ((number, *pair) for number, pair in enumerate(pairs))


def told(number: int, action: str, animal: str) -> str:
    secret = f" {SECRET}" if number == 0 else ""
    return f"to {action} the {animal} you need a lot of {ITEMS[ANIMALS.index(animal)]}{secret}"


def near(number: int) -> str:
    """Another action and another animal, apart."""
    action, animal = ACTIONS[(number + 1) % 5], ANIMALS[(number // 5 + 2) % 6]
    return f"yesterday a {animal} was there and nobody wanted to {action} anything"


def video_id(number: int) -> str:
    return f"video{number:06d}"


def second(number: int) -> float:
    """Where a video tells it."""
    return 61.5 + 4 * number


def write(root: Path, name: str, rows: list[dict[str, Any]]) -> None:
    """A clean table out of rows; columns that are not given are null, or 0 where they may not."""
    declared = table(name)
    schema = declared.arrow()
    arrays = [_column(field, rows) for field in schema]
    path = Layout(root).table(name) / "part-00000.parquet"
    write_table(path, pa.table(arrays, names=schema.names), declared)


def _column(field: pa.Field[Any], rows: list[dict[str, Any]]) -> pa.Array[Any]:
    kind = field.type.value_type if isinstance(field.type, pa.DictionaryType) else field.type
    instead: Any = None
    if not field.nullable:
        instead = START if pa.types.is_timestamp(kind) else "" if pa.types.is_string(kind) else 0
        instead = [] if pa.types.is_list(kind) else False if pa.types.is_boolean(kind) else instead
    return pa.array([row.get(field.name, instead) for row in rows], kind)


def world(root: Path, hostile: str = "") -> Path:
    """clean/ of all three sources; `hostile` is a comment more, under the first post."""
    youtube(root)
    wiki(root)
    reddit(root, hostile)
    return root


def youtube(root: Path) -> None:
    videos, transcripts = [], []
    for number, *_ in combinations():
        key = video_id(number)
        videos.append(
            {
                "video_id": key,
                "title": f"Episode {number}",
                "description": "A series about animals.",
                "license": "creativeCommon" if number % 2 else "youtube",
                "published_at": START + timedelta(days=number),
            }
        )
        at, cues = second(number), []
        for start, text in ((at - 8, FILLER), (at - 4, near(number)), (at, told(*_at(number)))):
            cues.append({"start_s": start, "duration_s": 3.5, "text": text})
        cues += [{"start_s": at + 4 * n, "duration_s": 3.5, "text": FILLER} for n in range(1, 12)]
        transcripts.append({"video_id": key, "kind": "asr", "language": "en", "cues": cues})
    write(root, "youtube/videos", videos)
    write(root, "youtube/transcripts", transcripts)


def _at(number: int) -> tuple[int, str, str]:
    return next(one for one in combinations() if one[0] == number)


def wiki(root: Path) -> None:
    pages, elements, cells, images = [], [], [], []
    for at, animal in enumerate(ANIMALS):
        key = 10 + at
        pages.append(
            {
                "page_id": key,
                "title": animal.capitalize(),
                "url": f"https://wiki.example/w/{animal.capitalize()}",
                "revision_id": 1000 + at,
                "revision_timestamp": START + timedelta(days=at),
                "license": "CC-BY-SA-3.0",
            }
        )
        parts: list[tuple[str, str, int | None, str | None]] = [
            ("text", "h1", 1, animal.capitalize()),
            ("text", "p", None, f"{near(at * 5)}."),
            ("table", "table", None, None),
            ("image", "img", None, None),
        ]
        for number, action, other in combinations():
            if other == animal:
                parts.append(("text", "h2", 2, f"Ways to {action}"))
                parts.append(("text", "p", None, f"{told(number, action, animal)}."))
        for order, (kind, tag, level, text) in enumerate(parts):
            elements.append(
                {
                    "page_id": key,
                    "element_id": order,
                    "kind": kind,
                    "tag": tag,
                    "region": "content",
                    "heading_level": level,
                    "text": text,
                    "visible": True,
                    "folded": False,
                    "reading_order": order,
                }
            )
        grid = (("Drops", "Amount"), (f"{animal} leather", str(at + 1)))
        for row, values in enumerate(grid):
            for column, text in enumerate(values):
                cells.append(
                    {
                        "page_id": key,
                        "table_id": 2,
                        "row_index": row,
                        "column_index": column,
                        "row_span": 1,
                        "column_span": 1,
                        "text": text,
                    }
                )
        images.append({"page_id": key, "element_id": 3, "alt_text": f"A sleeping {animal}"})
    for name, rows in (("pages", pages), ("elements", elements), ("cells", cells)):
        write(root, f"wiki/{name}", rows)
    write(root, "wiki/images", images)


def reddit(root: Path, hostile: str = "") -> None:
    posts, comments = [], []
    for number, action, animal in combinations():
        when = START + timedelta(days=number)
        # Even ones are told in the post, odd ones in a comment.
        told_here = told(number, action, animal)
        posts.append(
            {
                "post_id": f"p{number:03d}",
                "type": "text",
                "title": f"Question {number}",
                "body": near(number) if number % 2 else told_here,
                "created_utc": when,
            }
        )
        comments.append(
            {
                "comment_id": f"c{number:03d}",
                "post_id": f"p{number:03d}",
                "parent_id": f"t3_p{number:03d}",
                "depth": 0,
                "body": told_here if number % 2 else near(number + 1),
                "created_utc": when + timedelta(hours=1),
            }
        )
        if hostile and number == 0:
            comments.append({**comments[0], "comment_id": "c900", "body": hostile})
    write(root, "reddit/posts", posts)
    write(root, "reddit/comments", comments)
