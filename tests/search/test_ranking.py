"""Questions by hand on recorded real answers, with the video or thread that each is to find.

The answers are read in place and put into clean tables; eight questions more, on a wiki as
MediaWiki renders it, are in test_known_items.py.
"""

import html
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from kb.search.answers import search
from kb.search.build import index
from kb.search.ranking import Only
from tests.filters.made import run_at
from tests.search.made import write

VIDEOS = {
    "surfing a river in Africa": "4sqcVvWBK08",
    "surf beside sharks in South Africa": "y92SwP4odAk",
    "would it be possible to surf a tsunami?": "dVr3m9S0cEk",
    "how to fix the mistakes of a beginner": "c6yOxWf3A6g",
    "wave pool in Texas": "zQVpzCzQa1U",
    "where in Alaska can one surf": "BUhJwdet8Rs",
    "learn to surf in minutes": "67QNw2xQlsk",
    "freezing water, subzero, Nova Scotia": "w7DoXnRYMUg",
    "caching in a Flutter app": "Bud7XR8crWw",
    "best spots of Japan": "IurVzNwneYo",
}
THREADS = {
    "is cs 105 worth it": "5dec00",
    "naya burn deck": "5dec01",
    "format a DateTime without a string": "5dec42",
    "whose birthday is Orville Redenbacher's": "3dk1jh",
    "what does the sousaphone play, is it the Valkyries?": "3hahrw",
    "what does a new owner of a corgi need": "5dec22",
}


@pytest.fixture(scope="module")
def real(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("real") / "data"
    videos = dict(_videos(recorded / "youtube"))
    keys = sorted(videos)
    write(root, "youtube/videos", [videos[key] for key in keys])
    write(root, "youtube/transcripts", [])
    posts, comments = _threads(recorded / "reddit")
    write(root, "reddit/posts", sorted(posts.values(), key=lambda one: str(one["post_id"])))
    order = sorted(comments.values(), key=lambda one: (one["post_id"], one["comment_id"]))
    write(root, "reddit/comments", [one for one in order if one["post_id"] in posts])
    index(run_at(root))
    return root


def _videos(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    for path in sorted(folder.glob("*/*.json")):
        answer = json.loads(path.read_text(encoding="utf-8"))
        kind = answer.get("kind") if isinstance(answer, dict) else ""
        if kind not in ("youtube#searchListResponse", "youtube#videoListResponse"):
            continue
        for item in answer["items"]:
            key = (
                item["id"]["videoId"]
                if isinstance(item["id"], dict) and "videoId" in item["id"]
                else item["id"]
            )
            if isinstance(key, str):
                about = item["snippet"]
                title, text = html.unescape(about["title"]), about["description"]
                yield key, {"video_id": key, "title": title, "description": text}


def _threads(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    posts: dict[str, Any] = {}
    comments: dict[str, Any] = {}

    def walk(found: Any) -> None:
        if isinstance(found, list):
            for one in found:
                walk(one)
        if not isinstance(found, dict):
            return
        data = found.get("data")
        if found.get("kind") == "t3" and not data["over_18"]:
            posts[data["id"]] = {
                "post_id": data["id"],
                "type": "text",
                "title": data["title"],
                "body": data.get("selftext") or "",
                "created_utc": datetime.fromtimestamp(data["created_utc"], UTC),
            }
        elif found.get("kind") == "t1" and "link_id" in data:
            comments[data["id"]] = {
                "comment_id": data["id"],
                "post_id": data["link_id"].removeprefix("t3_"),
                "parent_id": data["parent_id"],
                "body": data["body"],
                "created_utc": datetime.fromtimestamp(data["created_utc"], UTC),
            }
        for one in found.values():
            walk(one)

    for path in sorted(folder.glob("*.json")):
        for step in json.loads(path.read_text(encoding="utf-8"))["interactions"]:
            body = step["response"]["body"]["string"]
            if body.startswith(("{", "[")):
                walk(json.loads(body))
    return posts, comments


@pytest.mark.parametrize(("words", "key"), VIDEOS.items())
def test_the_video_is_the_first_answer(real: Path, words: str, key: str) -> None:
    answers = search(real, words, sources=["youtube"], only=Only(limit=3))
    assert answers[0].key == key, [(one.title, one.score) for one in answers]
    assert answers[0].url == f"https://www.youtube.com/watch?v={key}"


@pytest.mark.parametrize(("words", "key"), THREADS.items())
def test_the_thread_is_the_first_answer(real: Path, words: str, key: str) -> None:
    answers = search(real, words, sources=["reddit"], only=Only(limit=3))
    assert f"/comments/{key}/" in answers[0].url, [(one.title, one.score) for one in answers]
