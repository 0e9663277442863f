"""A small data root made from the declared tables alone: clean and released rows of every source.

Values are invented and the same on every run. No crawl is needed, so that each gate line can be
tested with one wrong value.
"""

import functools
import hashlib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.sources import BY_DEFAULT
from kb.schema import Table, table
from kb.store.layout import Layout
from kb.store.tables.shard_writer import sorted_shards, write_table

START = datetime(2026, 11, 1, tzinfo=UTC)
VOCABULARY = (
    "how to build a small house with oak logs find diamonds craft an iron pickaxe tame the wolf"
    " farm wheat cave castle tower bridge torch furnace bread village trade emerald horse saddle"
    " boat river ocean island ship chest barrel stairs roof garden flower bee honey"
)
WORDS = VOCABULARY.split()
KEYWORDS = ("oak log", "diamond", "iron pickaxe", "wolf", "wheat")
Edit = Callable[[str, list[dict[str, Any]]], None]


def spread(*parts: object) -> int:
    """A number that looks random and is always the same."""
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:6], "big")


@functools.cache
def words(n: int, *seed: object) -> str:
    """`n` words of the invented vocabulary."""
    return " ".join(WORDS[spread(*seed, i) % len(WORDS)] for i in range(n))


def filled(declared: Table, row: dict[str, Any]) -> dict[str, Any]:
    """`row` with a plain value in every column that it leaves out."""
    plain = {"string": "x", "bool": False, "float64": 1.0, "float32": 0.01, "int64": 1, "int32": 1}
    for column in declared.columns:
        if column.name in row:
            continue
        if column.name.startswith("toxicity"):
            row[column.name] = 0.01
        elif column.nullable:
            row[column.name] = None
        elif column.type.startswith("list"):
            row[column.name] = []
        else:
            row[column.name] = START if column.type.startswith("timestamp") else plain[column.type]
    return row


def rows(n: int = 60) -> dict[str, list[dict[str, Any]]]:
    """Rows of every table, by table name."""
    made: dict[str, list[dict[str, Any]]] = {}
    made["youtube/videos"] = [
        {
            "video_id": f"vid{i:08d}",
            "title": words(5, "t", i),
            "link": f"https://www.youtube.com/watch?v=vid{i:08d}",
            "description": words(9, "d", i),
            "channel_id": f"UC{i % 7:022d}",
            "published_at": START - timedelta(days=30 * i),
            "view_count": 100 + int(10 ** (2 + spread("v", i) % 400 / 100)),
            "view_rule": "playback_start",
            "like_count": None if i % 9 == 0 else spread("l", i) % 900,
            "duration_s": 61 + int(1800 * (spread("dur", i) % 1000 / 1000) ** 3),
            "width": 1280,
            "height": 720,
            "category_id": 20,
            "topic_evidence": "game_label" if i % 3 else "keywords",
            "transcript_kind": ("manual", "asr", "translated")[i % 3],
            "transcript_origin": "service",
            "word_count": 500 + spread("w", i) % 3000,
            "license": "youtube",
            "metadata_origin": "api",
            "fetched_at": START + timedelta(hours=i),
        }
        for i in range(n)
    ]
    made["youtube/playlists"] = [
        {
            "playlist_id": f"PL{k:032d}",
            "title": words(4, "pl", k),
            "channel_id": f"UC{k:022d}",
            "item_count": n,
            "keyword": None if k else "how to build",
            "fetched_at": START + timedelta(hours=k),
        }
        for k in range(3)
    ]
    made["youtube/playlist_videos"] = [
        {"playlist_id": f"PL{i % 3:032d}", "video_id": f"vid{i:08d}", "position": i // 3}
        for i in range(0, n, 2)
    ]
    made["wiki/pages"] = [
        {
            "page_id": i + 1,
            "title": f"Page {i}",
            "url": f"https://wiki.example.org/wiki/Page_{i}",
            "revision_id": 1000 + i,
            "license": "CC-BY-NC-SA-3.0",
            "contributors_url": f"https://wiki.example.org/index.php?title=Page_{i}&action=history",
            "screenshot_path": f"raw/wiki/pages/{i + 1}.png",
            "page_width": 1280,
            "page_height": 900,
            "viewport_width": 1280,
            "word_count": 200,
            "fetched_at": START + timedelta(minutes=i),
            "revision_timestamp": START - timedelta(days=i),
        }
        for i in range(max(3, n // 10))
    ]
    made["wiki/elements"] = [
        {
            "page_id": page["page_id"],
            "element_id": k,
            "parent_id": None if k == 0 else 0,
            "visible": True,
            "folded": False,
            "reading_order": k,
            "kind": ("text", "image", "table", "cell", "sprite")[k % 5],
            "tag": ("h1", "img", "table", "td", "span")[k % 5],
            "region": ("content", "infobox", "navbox")[k % 3],
            "text": words(6, "e", page["page_id"], k) if k % 5 in (0, 3) else None,
            "x": 40.0 + 150 * (k % 5),
            "y": 30.0 + 70 * k,
            "width": 140.0,
            "height": 55.0,
            "lines": [
                {
                    "x": 40.0 + 150 * (k % 5),
                    "y": 32.0 + 70 * k + 20 * n,
                    "width": 90.0,
                    "height": 18.0,
                }
                for n in range(2)
            ]
            if k % 5 == 0
            else None,
        }
        for page in made["wiki/pages"]
        for k in range(12)
    ]
    made["wiki/facts"] = [
        {
            "page_id": page["page_id"],
            "fact_id": n,
            "subject": page["title"],
            "field": ("Weight", "Kept")[n],
            "value": ("3", "in a dry place")[n],
            "unit": ("kg", None)[n],
            "element_id": 3,
            "visible": True,
            "revision_id": page["revision_id"],
        }
        for page in made["wiki/pages"]
        for n in range(2)
    ]
    made["wiki/recipes"] = [
        {
            "page_id": page["page_id"],
            "recipe_index": 0,
            "slot": slot,
            "role": ("input", "output")[slot],
            "row_index": 0,
            "column_index": 0,
            "alternative": turn,
            "item": f"kind {turn}" if slot or turn else None,
            "quantity": 4 if slot or turn else None,
            "element_id": 1,
            "visible": True,
            "revision_id": page["revision_id"],
        }
        for page in made["wiki/pages"]
        for slot, turn in ((0, 0), (0, 1), (1, 0))
    ]
    made["wiki/cells"] = [
        {
            "page_id": page["page_id"],
            "table_id": 2,
            "row_index": r,
            "column_index": c,
            "row_span": 1,
            "column_span": 1,
            "is_header": r == 0,
            "text": words(2, "c", r, c),
            "x": 40.0 + 90 * c,
            "y": 170.0 + 20 * r,
            "width": 90.0,
            "height": 20.0,
        }
        for page in made["wiki/pages"]
        for r in range(3)
        for c in range(2)
    ]
    text = "# {}\n\n## Uses\n\nWords of a page about a thing."
    for page in made["wiki/pages"]:
        key, title = page["page_id"], page["title"]
        of = {"page_id": key}
        made.setdefault("wiki/page_text", []).append(
            {**of, "text": text.format(title), "word_count": len(text.format(title).split())}
        )
        made.setdefault("wiki/page_links", []).append(
            {
                **of,
                "target_page_id": 1,
                "target_title": made["wiki/pages"][0]["title"],
                "section": "Uses",
                "region": "content",
                "text": "a thing",
                "count": 1,
            }
        )
        made.setdefault("wiki/categories", []).append({**of, "category": "Things"})
        made.setdefault("wiki/redirects", []).append({"title": f"Old {title}", **of})
        made.setdefault("wiki/recipe_edges", []).append(
            {
                **of,
                "recipe_id": f"{key}-0",
                "slot": 0,
                "station": "crafting",
                "product": title,
                "product_slot": 9,
                "product_page_id": key,
                "product_quantity": 1,
                "ingredient": "Ash",
                "ingredient_page_id": None,
                "ingredient_quantity": 2,
                "alternatives": [],
                "revision_id": page["revision_id"],
            }
        )
    made["wiki/images"] = [
        {
            "page_id": page["page_id"],
            "element_id": 1,
            "src": f"https://wiki.example.org/images/{page['page_id']}.png",
            "path": f"raw/wiki/images/{page['page_id']}.png",
            "sha256": hashlib.sha256(b"picture %d" % page["page_id"]).hexdigest(),
            "media_type": "image/png",
            "width": 16,
            "height": 16,
            "alt_text": "a block",
            "license": None,
        }
        for page in made["wiki/pages"]
    ]
    made["reddit/posts"] = [
        {
            "post_id": f"p{i:05x}",
            "type": ("text", "image", "image", "video", "link", "poll", "gallery")[i % 7],
            "created_utc": START - timedelta(days=i),
            "score": 5 + spread("s", i) % 500,
            "num_comments": spread("nc", i) % 60,
            "comments_released": 3,
            "comments_unread": 0,
            "upvote_ratio": 0.9,
            "score_source": "live",
            "fetched_at": START + timedelta(seconds=i),
            "title": words(6, "rt", i),
            "body": words(20, "rb", i),
            "author_hash": f"{spread('a', i % 11):012x}",
        }
        for i in range(n)
    ]
    made["reddit/comments"] = [
        {
            "comment_id": f"c{i:05x}{j}",
            "post_id": f"p{i:05x}",
            "parent_id": f"t3_p{i:05x}" if j == 0 else f"t1_c{i:05x}{j - 1}",
            "parent_comment_id": None if j == 0 else f"c{i:05x}{j - 1}",
            "depth": j,
            "parent_in_release": True,
            "created_utc": START,
            "score": j,
            "score_source": "live",
            "fetched_at": START,
            "body": words(8, "cb", i, j),
        }
        for i in range(n)
        for j in range(3)
    ]
    made["pairs/pairs"] = [
        {
            "pair_id": f"{spread('p', i):012x}",
            "video_id": f"vid{i % n:08d}",
            "keyword": KEYWORDS[spread("k", i) % 5 % (1 + i % 5)],
            "keyword_kind": "item",
            "text": words(12, "pt", i),
            "token_count": 16 + spread("tok", i) % 62,
            "match_start_s": 10.0,
            "match_end_s": 11.0,
            "segment_start_s": 9.0,
            "segment_end_s": 12.0,
            "text_start_s": 6.0,
            "text_end_s": 16.0,
            "center_s": 10.5,
            "clip_start_s": 10.5 - (8 + spread("clip", i) % 80 / 10) / 2,
            "clip_end_s": 10.5 + (8 + spread("clip", i) % 80 / 10) / 2,
            "transcript_kind": "asr",
            "match_in_clip": True,
            "timing": ("word", "cue")[i % 2],
        }
        for i in range(2 * n)
    ]
    made["pairs/quality"] = [
        {
            "pair_id": row["pair_id"],
            "video_id": row["video_id"],
            "clip_start_s": row["clip_start_s"],
            "duplicate_of": None,
            "duplicate_video_id": None,
            "cluster_size": 1,
            "recurring_share": spread("rs", i) % 11 / 10,
            "language": "en",
            "language_confidence": None,
            "has_verb": i % 3 > 0,
            "keyword_count": 1 + i % 4,
            "words_per_second": 2.5,
            "video_words_per_second": 2.0,
            "interpolation_error_s": None if i % 2 else spread("ie", i) % 100 / 100 - 0.4,
        }
        for i, row in enumerate(made["pairs/pairs"])
    ]
    made["tasks/tasks"] = [
        {
            "task_id": f"{spread('t', i):016x}",
            "prompt": f"build {words(2, 'task', i)}",
            "video_id": f"vid{i:08d}",
            "start_s": None if i % 3 else 20.0 + i,
            "end_s": None if i % 3 else 80.0 + i,
            "start_source": "none" if i % 3 else "transcript",
            "collection": "youtube",
            "reasons": [],
            "rejected_reason": None,
        }
        for i in range(n)
    ]
    made["links/entities"] = [
        {
            "entity": keyword,
            "kind": "item",
            "aliases": [f"{keyword.lower()}s"],
            "wiki_page_id": i + 1 if i % 2 else None,
        }
        for i, keyword in enumerate(sorted(KEYWORDS))
    ]
    # The first keyword is named everywhere, others by fewer, the last one by videos alone.
    made["links/links"] = [
        {
            "entity": keyword,
            "source": source,
            "key": key.format(i),
            "video_id": f"vid{i:08d}" if source == "youtube" else None,
            "page_id": i if source == "wiki" else None,
            "post_id": f"p{i:05x}" if source == "reddit" else None,
            "comment_id": f"c{i:05x}0" if source == "reddit" else None,
            "part": part,
            "how": "mention",
            "count": 1 + spread("links", i) % 4,
            "first_at_s": 1.5 * i if part == "transcript" else None,
        }
        for rank, keyword in enumerate(KEYWORDS)
        for source, part, key in (
            ("youtube", "transcript", "vid{:08d}"),
            ("wiki", "page", "{}"),
            ("reddit", "comment", "t1_c{:05x}0"),
        )
        for i in range(n // (rank + 1))
        if source == "youtube" or rank < len(KEYWORDS) - 1
    ]
    return made


REJECTED = {
    "youtube": [
        ("missing", "not_found", None, None, 9),
        ("topic", "other_game", "UCother", None, 25),
        ("views", "below", "12", "100", 31),
        ("aspect_ratio", "below", "0.56", "1.0", 8),
        ("duration", "below", "31", "60", 12),
        ("age_restricted", "true", "true", None, 2),
        ("toxicity", "above", "0.91", "0.5", 4),
        ("transcript", "none", "none", None, 11),
    ],
    "wiki": [
        ("missing", "deleted", None, None, 1),
        ("render", "timeout", None, None, 1),
        ("words", "below", "7", "20", 3),
    ],
    "reddit": [
        ("removed", "removed", None, None, 14),
        ("nsfw", "true", "true", None, 5),
        ("score", "below", "1", "5", 40),
        ("toxicity", "above", "0.8", "0.5", 3),
    ],
}
NAMES = {
    "pairs/pairs": "pairs-00000-of-00001.parquet",
    "pairs/quality": "quality-00000-of-00001.parquet",
    "tasks/tasks": "tasks-00000-of-00001.parquet",
    "links/entities": "entities-00000-of-00001.parquet",
    "links/links": "links-00000-of-00001.parquet",
}


def build(
    root: Path,
    edit: Edit | None = None,
    sources: tuple[str, ...] = BY_DEFAULT,
    n: int = 60,
    *,
    export: bool = True,
) -> Path:
    """Write clean/, pairs/, tasks/, links/ and release/ under `root`. `edit(table, rows)` may
    change rows first.
    """
    for name, made in rows(n).items():
        if name.partition("/")[0] not in sources:
            continue
        declared = table(name)
        if edit:
            edit(name, made)
        arrow = pa.Table.from_pylist([filled(declared, row) for row in made], declared.arrow())
        path = Layout(root).table(name) / NAMES.get(name, "part-00000.parquet")
        part = write_table(path, arrow, declared)
        if export and not name.startswith("wiki/"):
            released(root, name, part.path)
    for source, lines in REJECTED.items():
        if source not in sources:
            continue
        made = [
            {
                "key": f"{'t3_' if source == 'reddit' else ''}{stage}{i}",
                "stage": stage,
                "reason": reason,
                "value": value,
                "threshold": threshold,
            }
            for stage, reason, value, threshold, n_rows in lines
            for i in range(n_rows)
        ]
        declared = table("shared/rejected")
        write_table(
            root / "clean" / source / "rejected" / "part-00000.parquet",
            pa.Table.from_pylist(made, declared.arrow()),
            declared,
        )
    if export and "wiki" in sources:
        archived(root)
    return root


def archived(root: Path) -> None:
    """The wiki's files, and its export: tables, tars and their index."""
    from kb.wiki import tar_shards
    from tests.release.conftest import a_run

    for column, what in (
        ("pages/screenshot_path", b"screenshot of %d"),
        ("images/path", b"picture %d"),
    ):
        short, _, name = column.partition("/")
        for row in pq.read_table(
            root / "clean" / "wiki" / short / "part-00000.parquet", columns=["page_id", name]
        ).to_pylist():
            if row[name]:
                (root / row[name]).parent.mkdir(parents=True, exist_ok=True)
                (root / row[name]).write_bytes(what % row["page_id"])
    tar_shards.export(a_run(root))


def released(root: Path, name: str, part: Path, shard_rows: int = 40) -> None:
    """What an export does: the released columns as sorted shards; videos come in more than one."""
    declared = table(name)
    folder = root / "release" / declared.source
    sorted_shards(
        [part],
        folder,
        declared,
        **({"shard_bytes": 1, "group_rows": shard_rows} if name == "youtube/videos" else {}),
    )
