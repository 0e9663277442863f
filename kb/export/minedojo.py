"""`--format minedojo`: all sources, pairs and tasks as in the published MineDojo data.

`youtube_full.json` is a JSON list of `id, title, link, view_count, like_count, duration` (seconds)
`, fps`; `youtube_tutorial.json`, which its loader reads for `full=False`, has of these the videos
that a playlist found by the profile's phrases lists; where there is no such playlist, those whose
title says that they teach.

`reddit.json` is a list of `id` and `type`. The published loader, and `kb reddit reconstruct`, bring
the content back by id. The loader knows text, image, video and link and takes a post's content by
its type; so a poll is a text (as in the paper: its content is the post's own text), and a gallery
an image (its content is the gallery's address).

`creative_tasks.yaml` is a mapping of `creative:<n>` to `collection, guidance, prompt` and `source`
with `youtube_id, start, end` in whole seconds, 0 and the video's length where the time is not
known. Guidance is null, as in the published tasks from YouTube.

`pairs.json` is `{keyword: [[video_id, start, end], …]}` (seconds), without text, a keyword a line.

    wiki_full/<title as in the page's address>/data.json, screenshot.png, images/
    {"metadata": {url, title, time},
     "tables": [{bbox, headers {text, bboxes}, cells {text, bboxes}}],
     "images": [{src, path, alt_text, caption, bbox}],
     "sprites": [{text, bbox}], "texts": [{text, bbox}]}
    wiki_samples/         the first pages, which its loader reads with full=False

bbox is [x, y, w, h] in pixels of the screenshot, x and y floats, w and h whole. Texts: none inside
of a table, and none that another one holds (a list and its items: the list). Null where a caption
or a sprite's text is not there. Pillow refuses screenshots above 178.9 megapixels
(`Image.MAX_IMAGE_PIXELS`), so the published loader does too. Only what the screenshot shows is in
it, as there. SVG files, which its loader can't open, are given as the screenshot shows them.

All files are ASCII, as published. Source: "MineDojo: Building Open-Ended Embodied Agents with
Internet-Scale Knowledge" (NeurIPS 2022), data appendix.
"""

import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from kb.artifacts import manifest
from kb.artifacts.stored_files import stored_file
from kb.artifacts.table_catalog import Catalog
from kb.artifacts.texts import exported_files
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export.rows import Row, check_rows, json_list, sorted_rows
from kb.schema.wiki_page import ancestors
from kb.store.atomic import replacing_folder, writing
from kb.store.layout import CAPTURED, Layout
from kb.store.rawlog import sidefiles
from kb.store.rawlog.sidefiles import captured_file
from kb.store.tables import database
from kb.store.tables.merge import RowsByKey
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


# MineDojo chose its tutorials by playlists; where none was read, a title is what there is.
_TEACHES = re.compile(
    r"\b(tutorials?|guides?|walk-?throughs?|how to|beginners?|basics|step by step|lessons?|"
    r"explained|tips)\b",
    re.IGNORECASE,
)
# Types that MineDojo's loader does not know, and what they are there.
TYPES = {"poll": "text", "gallery": "image"}


def youtube(run: Run, out: Path | None = None) -> Summary:
    """Writes both lists of videos, sorted by id. Raises FatalError without clean rows, DiskFull."""
    check_rows(run.root, "youtube/videos")
    path = (out or Layout(run.root).export("minedojo")) / "youtube_full.json"
    count, listed = 0, _listed(run.root)
    with json_list(path) as add, json_list(path.with_name("youtube_tutorial.json")) as add_tutorial:
        for row in sorted_rows(run.root, "youtube/videos", list(YOUTUBE.values()), ["video_id"]):
            video = {name: row[ours] for name, ours in YOUTUBE.items()}
            add(video)
            if video["id"] in listed if listed else _TEACHES.search(video["title"] or ""):
                add_tutorial(video)
            count += 1
    return Summary(format="minedojo", videos=count, path=str(path))


def _listed(root: Path) -> set[str]:
    """The videos of playlists that a phrase of the profile found. Raises DamagedData."""
    found = {
        row["playlist_id"]
        for row in sorted_rows(root, "youtube/playlists", ["playlist_id", "keyword"])
        if row["keyword"] is not None
    }
    entries = sorted_rows(root, "youtube/playlist_videos", ["playlist_id", "video_id", "position"])
    return {row["video_id"] for row in entries if row["playlist_id"] in found}


def reddit(run: Run, out: Path | None = None) -> Summary:
    """Writes the list of posts, sorted by id. Raises FatalError without clean rows, DamagedData,
    DiskFull.
    """
    check_rows(run.root, "reddit/posts")
    path = (out or Layout(run.root).export("minedojo")) / "reddit.json"
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


_SAMPLES = 10  # pages
_BOX = ["x", "y", "width", "height"]


def wiki(run: Run, out: Path | None = None) -> Summary:
    """Writes wiki_full and wiki_samples, one page at a time: to `out` where it is given, as it is
    for a download. Raises FatalError without rows, DamagedData, DiskFull.
    """
    check_rows(run.root, "wiki/pages")
    target = (out or Layout(run.root).export("minedojo")) / "wiki_full"
    home = _home(run.root)
    count, taken, samples = 0, set(), []
    pages = sorted_rows(
        run.root,
        "wiki/pages",
        ["page_id", "title", "url", "fetched_at", "screenshot_path"],
        ["page_id"],
    )
    elements = _by_page(
        run,
        "wiki/elements",
        ("reading_order",),
        ("element_id", "parent_id", "kind", "text", *_BOX, "visible"),
    )
    cells = _by_page(
        run,
        "wiki/cells",
        ("table_id", "row_index", "column_index"),
        ("is_header", "text", *_BOX),
    )
    images = _by_page(
        run,
        "wiki/images",
        ("element_id", "frame_index"),
        ("src", "path", "sha256", "media_type", "alt_text", "caption"),
    )
    with replacing_folder(target) as fresh:
        for page in pages:
            name = folder_name(page["url"], page["title"])
            if (
                name.casefold() in taken
            ):  # addresses that differ by case only, on file systems that don't
                name = f"{name}~{page['page_id']}"
            taken.add(name.casefold())
            if count < _SAMPLES:
                samples.append(name)
            folder = fresh / name
            (folder / "images").mkdir(parents=True)
            _copy(home, page["screenshot_path"], folder / "screenshot.png")
            key = page["page_id"]
            rows = (list(table.rows_of(key)) for table in (elements, cells, images))
            data = _data(home, folder, page, *rows)
            (folder / "data.json").write_text(json.dumps(data, indent=2), encoding="ascii")
            count += 1
    with replacing_folder(target.with_name("wiki_samples")) as fresh:
        for name in samples:  # a subpage's folder is inside of its page's, and not part of it
            shutil.copytree(target / name / "images", fresh / name / "images")
            for file in ("data.json", "screenshot.png"):
                shutil.copyfile(target / name / file, fresh / name / file)
    return Summary(format="minedojo", pages=count, path=str(target))


def _home(root: Path) -> Path:
    """Where the paths of rows start from: the data root, or the release folder of a download."""
    catalog = Catalog(root.absolute())
    return exported_files(catalog, "wiki/pages")[0].parent if catalog.is_download else root


def _by_page(run: Run, name: str, order: Sequence[str], columns: Sequence[str]) -> RowsByKey:
    by = ["page_id", *order]
    return RowsByKey(sorted_rows(run.root, name, [*by, *columns], by), "page_id")


_OWN = {"data.json", "screenshot.png", "images"}


def folder_name(url: str, title: str) -> str:
    """The page's folder: its title as the address has it, percent-encoded ("Caf%C3%A9").

    A subpage is a folder below its page's. What the address leaves as it is and a file system or
    the published loader can't have (a colon, a leading dot) is percent-encoded too, so that no step
    leads elsewhere and each leads back to its address.
    """
    parts = urlsplit(url)
    steps = [step for step in parts.path.split("/") if step]
    named = [step for step in title.split("/") if step]
    if parts.query:  # index.php?title=…: the path is the same for all
        steps = [quote(step.replace(" ", "_"), safe="") for step in named]
    # What stands before the title ("/wiki/") is the site's own.
    words = title.replace("_", " ")
    tails = (steps[-count:] for count in range(1, len(steps) + 1))
    exact = (tail for tail in tails if unquote("/".join(tail)).replace("_", " ") == words)
    steps = next(exact, steps[-max(1, len(named)) :])
    plain = [_plain(step) for step in steps or "_"]
    # What a page's own folder holds names no subpage: "data.json" becomes "%64ata.json".
    below = [
        f"%{ord(part[0]):02X}{part[1:]}" if part.casefold() in _OWN else part for part in plain[1:]
    ]
    return str(Path(plain[0], *below))


def _plain(step: str) -> str:
    """A step that is a plain name: no file system's own characters, no dot at its start, and at
    most 200 bytes.
    """
    name = re.sub(r"^\.", "%2E", quote(step, safe="%!$&'()+,;=@~"))
    raw = name.encode()
    if len(raw) <= 200:
        return name
    return f"{raw[:180].decode(errors='ignore')}~{hashlib.sha256(raw).hexdigest()[:12]}"


def box(row: Row) -> list[float | int]:
    """[x, y, w, h] in pixels: x and y floats, w and h whole and at least 1."""
    return [
        float(row["x"]),
        float(row["y"]),
        max(1, round(row["width"])),
        max(1, round(row["height"])),
    ]


def _data(
    home: Path, folder: Path, page: Row, elements: list[Row], cells: list[Row], images: list[Row]
) -> Row:
    seen = {row["element_id"]: row for row in elements if row["visible"]}
    of_table = {
        number: list(group) for number, group in groupby(cells, key=lambda row: row["table_id"])
    }
    shown = [
        row
        for row in images
        if row["element_id"] in seen
        and seen[row["element_id"]]["kind"] != "sprite"
        and not row["frame_index"]
    ]
    return {
        "metadata": {
            "url": page["url"],
            "title": page["title"],
            "time": page["fetched_at"].strftime("%d/%m/%Y %H:%M:%S"),
        },
        "tables": [
            _table(row, of_table.get(row["element_id"], []))
            for row in seen.values()
            if row["kind"] == "table"
        ],
        "images": [
            image for row in shown if (image := _image(home, folder, row, seen[row["element_id"]]))
        ],
        "sprites": [
            {"text": row["text"] or None, "bbox": box(row)}
            for row in seen.values()
            if row["kind"] == "sprite"
        ],
        "texts": [{"text": row["text"], "bbox": box(row)} for row in own_texts(elements)],
    }


def own_texts(elements: list[Row]) -> list[Row]:
    """Shown text elements that are in no table, and whose words no text around them contains."""
    every = {row["element_id"]: row for row in elements}
    parents = {key: row["parent_id"] for key, row in every.items()}
    words = {
        key: "".join(row["text"].split())  # spaces differ by how lines break
        for key, row in every.items()
        if row["kind"] == "text" and row["visible"] and row["text"]
    }
    return [
        every[key]
        for key, text in words.items()
        if not any(
            every[above]["kind"] in ("table", "cell") or text in words.get(above, "")
            for above in ancestors(key, parents)
        )
    ]


def _table(row: Row, cells: list[Row]) -> Row:
    parts = {
        True: [cell for cell in cells if cell["is_header"]],
        False: [cell for cell in cells if not cell["is_header"]],
    }
    by_kind = {
        kind: {"text": [cell["text"] for cell in part], "bboxes": [box(cell) for cell in part]}
        for kind, part in parts.items()
    }
    return {"bbox": box(row), "headers": by_kind[True], "cells": by_kind[False]}


def _image(home: Path, folder: Path, row: Row, element: Row) -> Row | None:
    """One image with its file beside the page; None where the wiki could not give the file."""
    if not row["path"]:
        return None
    name = Path(row["path"]).name
    if row["media_type"] == "image/svg+xml":
        name = f"{row['sha256']}-{row['element_id']}.png"
        _crop(folder / "screenshot.png", box(element), folder / "images" / name)
    elif not (folder / "images" / name).exists():
        _copy(home, row["path"], folder / "images" / name)
    return {
        "src": row["src"],
        "path": f"images/{name}",
        "alt_text": row["alt_text"] or "",
        "caption": row["caption"] or None,
        "bbox": box(element),
    }


def _copy(home: Path, path: str, target: Path) -> None:
    """A screenshot or image. Raises DamagedData for one that is not what was stored."""
    if ".tar/" not in path and not sidefiles.is_intact(file := captured_file(home, path)):
        raise sidefiles.lost(home, CAPTURED, [file])  # the next crawl fetches it again
    data, _ = stored_file(home, path)
    target.write_bytes(data)


def _crop(screenshot: Path, where: list[float | int], target: Path) -> None:
    from PIL import Image

    limit, Image.MAX_IMAGE_PIXELS = (
        Image.MAX_IMAGE_PIXELS,
        None,
    )  # our own image, whose size the crawl has checked
    try:
        with Image.open(screenshot) as image:
            x, y, width, height = map(round, where)
            image.crop((x, y, x + width, y + height)).save(target, "PNG")
    finally:
        Image.MAX_IMAGE_PIXELS = limit
