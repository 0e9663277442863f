"""The kinds of posts of the invented subreddit, each in the form of Reddit's answers."""

from __future__ import annotations

import random
from typing import Any

from kb.sandbox.domain import Domain

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


def shape(post: dict[str, Any], case: str, domain: Domain, rng: random.Random) -> None:
    """Make an ordinary post one of that case."""
    key = post["id"]
    links = {
        "image": f"https://i.redd.it/{key}pic.png",
        "image_album": f"https://imgur.com/a/{key}",
        "image_direct": f"https://pictures.example/{key}.jpg",
        "video_hosted": f"https://v.redd.it/{key}",
        "video_youtube": f"https://www.youtube.com/watch?v={key}vid0",
        "video_gifv": f"https://i.imgur.com/{key}.gifv",
        "link": f"https://notes.example/{domain.speech.link_word(rng)}/{key}",
        "link_video_page": "https://www.youtube.com/@brisk-otter-builds",
        "gallery": f"https://www.reddit.com/gallery/{key}",
    }
    if case in links:
        post |= {
            "is_self": False,
            "selftext": "",
            "url": links[case],
            "url_overridden_by_dest": links[case],
            "domain": links[case].split("/")[2],
            "is_video": case == "video_hosted",
        }
        if case == "image":
            post["post_hint"] = "image"
    if case == "gallery":
        post |= {
            "is_gallery": True,
            "gallery_data": {
                "items": [{"media_id": f"{key}a", "id": 1}, {"media_id": f"{key}b", "id": 2}]
            },
            "media_metadata": {
                f"{key}{part}": {"status": "valid", "e": "Image", "m": "image/png"} for part in "ab"
            },
        }
    elif case == "poll":
        post["poll_data"] = {
            "options": [
                {"text": word, "id": str(n), "vote_count": 3 * n}
                for n, word in enumerate(domain.words.poll)
            ],
            "total_vote_count": 3,
            "voting_end_timestamp": int(post["created_utc"] * 1_000) + 86_400_000,
        }
    elif case == "crosspost":
        parent = {
            **post,
            "id": "zz9zz9",
            "name": "t3_zz9zz9",
            "subreddit": "u_mossy_heron17",
            "is_self": False,
            "selftext": "",
            "permalink": "/user/mossy_heron17/comments/zz9zz9/post/",
            "url": "https://v.redd.it/zz9zz9",
            "is_video": True,
        }
        post |= {
            "crosspost_parent": "t3_zz9zz9",
            "crosspost_parent_list": [parent],
            "is_self": False,
            "selftext": "",
            "url": "https://v.redd.it/zz9zz9",
        }
    elif case == "low_score":
        post["score"] = rng.randrange(0, max(1, domain.min_score))
    elif case == "no_score":
        del post["score"]
    elif case == "nsfw":
        post["over_18"] = True
    elif case == "removed":
        post |= {
            "selftext": "[removed]",
            "removed_by_category": "moderator",
            "is_robot_indexable": False,
        }
    elif case == "deleted":
        post |= {
            "selftext": "[deleted]",
            "author": "[deleted]",
            "removed_by_category": "deleted",
            "is_robot_indexable": False,
        }
        del post["author_fullname"]
    elif case == "rude_title":
        post["title"] = RUDE[0].capitalize()
    elif case == "rude_body":
        post["selftext"] = RUDE[1]
    elif case == "odd_text":
        post |= {
            "title": "A tower 🗼 مرحبا & <b>bold</b>",
            "selftext": "tab\tand\0nul and \ud83d alone",
        }
    elif case == "empty_text":
        post["selftext"] = ""
