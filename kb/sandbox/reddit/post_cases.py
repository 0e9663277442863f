"""The kinds of posts of the invented subreddit, each in the form of Reddit's answers, which are
written down in data/reddit/posts.json.
"""

from __future__ import annotations

import random
import re
from functools import partial
from typing import Any

from kb.sandbox.domain import Domain
from kb.sandbox.invented_ids import ELSEWHERE, PEOPLE, video_id
from kb.sandbox.json_templates import written
from kb.sandbox.speech import Cast

RUDE = [
    "you are a stupid worthless idiot",
    "shut up you pathetic moron",
    "what a dumb ugly loser you are",
]
CASES = (
    "text",
    "image",
    "image_album",
    "image_direct",
    "video_hosted",
    "video_youtube",
    "video_gifv",
    "link",
    "poll",
    "gallery",
    "crosspost",
    "low_score",
    "nsfw",
    "removed",
    "deleted",
    "rude_title",
    "rude_body",
    "odd_text",
    "no_score",
    "deep",
    "wide",
    "link_video_page",
    "empty_text",
)
_CHANGED = (  # cases that are written down
    "image",
    "gallery",
    "poll",
    "crosspost",
    "nsfw",
    "removed",
    "deleted",
    "odd_text",
    "empty_text",
)
_written = partial(written, "reddit/posts.json")


def shape(post: dict[str, Any], case: str, domain: Domain, cast: Cast, rng: random.Random) -> None:
    """Make an ordinary post one of that case."""
    key = post["id"]
    word = "-".join(re.findall(r"\w+", cast.subject.name))
    links = _written("links", {"key": key, "word": word, "video": video_id(rng)})
    values: dict[str, Any] = {"key": key, "elsewhere": ELSEWHERE, "person": PEOPLE[-1]}
    if case in links:
        url, is_video = links[case], case == "video_hosted"
        post |= _written("linked", {"url": url, "host": url.split("/")[2], "is_video": is_video})
    if case == "gallery":
        media = {"status": "valid", "e": "Image", "m": "image/png"}
        values["media"] = {f"{key}{part}": dict(media) for part in "ab"}
    elif case == "poll":
        first, second = cast.subject.name, cast.others[0].name
        values["options"] = [
            {"text": text, "id": str(n), "vote_count": 3 * n}
            for n, text in enumerate((first, f"{first} & {second}"))
        ]
        values["end"] = int(post["created_utc"] * 1_000) + 86_400_000
    elif case == "crosspost":
        values["parent"] = {**post, **_written("parent", values)}
    if case in _CHANGED:
        post |= _written(case, values)
    elif case == "low_score":
        post["score"] = rng.randrange(0, max(1, domain.min_score))
    elif case == "no_score":
        del post["score"]
    elif case == "rude_title":
        post["title"] = RUDE[0].capitalize()
    elif case == "rude_body":
        post["selftext"] = RUDE[1]
    if case == "deleted":
        del post["author_fullname"]
