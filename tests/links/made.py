"""Small clean tables of all three sources, and a run with keywords of its own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.links.build import build
from kb.registry import SOURCES as CLASSES
from kb.schema.wiki_page import PageNames
from kb.store.layout import Layout
from tests.search.made import write

LIST = """keyword\tkind\trule\tforms
Creeper\tentity
Wolf\tentity\t\twolfie, hound
Oak\tblock
Oak Log\tblock
Iron Golem\tentity
Ender Dragon\tentity\t\tdragon
Bed\tblock\tnear:3
Chest\tblock\tnear:2
Air\tblock\tnever
"""
FIRST_PAGE = 10
WORDS = (
    *("the", "a", "and", "goes", "slowly"),
    *("creeper", "Creepers", "wolf", "wolves", "Hound", "oak", "log", "oak-log", "OAK", "iron"),
    *("golem", "irongolem", "ender", "dragon", "bed", "beds", "chest", "air", "chest day", "wolf!"),
)


def run_at(root: Path, **more: Any) -> Run:
    """The shipped profile with these keywords."""
    place = root.parent / "profile"
    place.mkdir(parents=True, exist_ok=True)
    (place / "keywords.tsv").write_text(LIST)
    text = load_profile("minecraft").path.read_text().replace("near_words = 20", "near_words = 5")
    path = place / "profile.toml"
    path.write_text(text)
    return Run(load_settings(dotenv=False), load_profile(path), root, **{"workers": 1, **more})


def fill(
    root: Path,
    videos: Sequence[tuple[str, str, Sequence[tuple[int, str]]]] = (),
    pages: Sequence[tuple[str, Sequence[str]]] = (),
    posts: Sequence[tuple[str, str, Sequence[str]]] = (),
    comments: Sequence[str] = (),
) -> None:
    """Videos (title, description, cues), pages (title, blocks), posts (title, body, poll) and
    comments; keys are their numbers, of pages from FIRST_PAGE on.
    """
    if videos:
        write(root, "youtube/videos", [_video(at, *one) for at, one in enumerate(videos)])
        write(root, "youtube/transcripts", [_spoken(at, one[2]) for at, one in enumerate(videos)])
    if pages:
        numbered = list(enumerate(pages, FIRST_PAGE))
        write(root, "wiki/pages", [{"page_id": n, "title": one[0]} for n, one in numbered])
        blocks = [(n, at, text) for n, one in numbered for at, text in enumerate(one[1])]
        write(root, "wiki/elements", [_element(*one) for one in blocks])
    if posts or comments:
        write(root, "reddit/posts", [_post(at, *one) for at, one in enumerate(posts)])
        write(root, "reddit/comments", [_comment(at, one) for at, one in enumerate(comments)])


def video_id(number: int) -> str:
    return f"video{number:06d}"


def _video(number: int, title: str, body: str, cues: Sequence[tuple[int, str]]) -> dict[str, Any]:
    last = float(cues[-1][0] + 1) if cues else 1.0
    about = {"title": title, "description": body, "duration_s": last}
    return {"video_id": video_id(number), **about}


def _spoken(number: int, cues: Sequence[tuple[int, str]]) -> dict[str, Any]:
    rows = [{"start_s": float(at), "duration_s": 100.0, "text": text} for at, text in cues]
    return {"video_id": video_id(number), "kind": "asr", "language": "en", "cues": rows}


def _element(page: int, number: int, text: str) -> dict[str, Any]:
    about = {"kind": "text", "tag": "p", "region": "content", "visible": True, "folded": False}
    place = {"page_id": page, "element_id": number, "reading_order": number}
    return {**place, **about, "text": text}


def _post(number: int, title: str, body: str, poll: Sequence[str]) -> dict[str, Any]:
    options = list(poll) or None
    return {"post_id": f"p{number}", "title": title, "body": body, "poll_options": options}


def _comment(number: int, body: str) -> dict[str, Any]:
    return {"comment_id": f"c{number}", "post_id": "p0", "parent_id": "t3_p0", "body": body}


def links(run: Run, names: dict[str, PageNames] | None = None) -> dict[str, Any]:
    """Make them; the summary."""
    return dict(build(run, CLASSES, lambda: names or {}))


def rows(root: Path, name: str = "links") -> list[dict[str, Any]]:
    files = Layout(root).rows(f"links/{name}")
    return [row for path in files for row in pq.read_table(path).to_pylist()]
