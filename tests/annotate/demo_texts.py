"""What the demo scores, out of its invented world, and what its word lists say of a text."""

import html
import re
import tomllib
from pathlib import Path

from kb.sandbox.toxicity import DATA
from kb.sandbox.wiki.generated import DATA as WIKI
from kb.sandbox.world import World

WORDS = tomllib.loads((DATA / "words.toml").read_text(encoding="utf-8"))
KINDS: dict[str, list[str]] = WORDS["kinds"]
_WORD = re.compile(r"[^\W_]+|[^\w\s]|_")


def demo_texts() -> list[str]:
    """Titles, descriptions, posts, comments (the dumps' as well) and wiki pages, each text once."""
    world = World()
    found = [
        text for video in world.youtube.videos.values() for text in (video.title, video.description)
    ]
    posts, comments = world.reddit.archive
    for post in (*world.reddit.posts.values(), *posts.values()):
        found += [post["title"], post["selftext"]]
    for comment in (*world.reddit.comments.values(), *comments.values()):
        found.append(comment["body"])
    for page in sorted(Path(WIKI, "html").rglob("*.html")):
        bare = re.sub(r"(?s)<(script|style).*?</\1>|<[^>]+>", " ", page.read_text(encoding="utf-8"))
        found.append(" ".join(html.unescape(bare).split()))
    storable = [re.sub("[\0\ud800-\udfff]", "\ufffd", text) for text in found if text]
    return list(dict.fromkeys(storable))
