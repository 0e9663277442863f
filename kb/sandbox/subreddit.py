"""The invented subreddit: posts of every kind and comments below them, in the form of Reddit's
answers.

The first posts cover every case once (CASES); the rest are ordinary. Insults are our own words
for the sandbox's toxicity model. Times are fixed, so that the same seed gives the same world.
"""

from __future__ import annotations

import random
from functools import cached_property
from typing import Any

from kb.core import clock
from kb.sandbox.domain import Domain, usual

START = 1_700_000_000  # 2023-11-14
_YEAR = 31_536_000
_PEOPLE = [
    f"{first}_{second}{n}"
    for n, (first, second) in enumerate(
        (first, second)
        for first in ("brisk", "quiet", "sunny", "rusty", "tidy", "mossy")
        for second in ("otter", "lantern", "anvil", "heron", "pebble")
    )
]
_RUDE = [
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


class Subreddit:
    """`posts` and `comments` by bare id.

    `n_posts` in all; `width` replies below the "wide" post, `depth` below the "deep" one.
    """

    def __init__(
        self,
        seed: int = 0,
        n_posts: int = 240,
        *,
        width: int = 1_200,
        depth: int = 40,
        name: str | None = None,
        domain: Domain | None = None,
    ) -> None:
        self.seed, self.n_posts, self.width, self.depth = seed, n_posts, width, depth
        self.domain = domain or usual()
        self.name = name or self.domain.subreddit
        self.room = 1_000  # requests in ten minutes, of whoever asks
        self.gone: set[str] = set()  # full names that the service no longer knows
        self.removed: set[str] = set()  # full names whose content moderators took down

    @cached_property
    def posts(self) -> dict[str, dict[str, Any]]:
        """Posts, oldest first, with the number of their comments from the first answer on."""
        found = {post["id"]: post for post in (self._post(n) for n in range(self.n_posts))}
        self._threads = [self._thread(number, post) for number, post in enumerate(found.values())]
        return found

    @cached_property
    def comments(self) -> dict[str, dict[str, Any]]:
        """All comments, parents before replies."""
        assert self.posts  # they come with their threads
        return {comment["id"]: comment for thread in self._threads for comment in thread}

    @cached_property
    def replies(self) -> dict[str, list[str]]:
        """Ids of the direct replies by the parent's full name."""
        below: dict[str, list[str]] = {}
        for comment in self.comments.values():
            below.setdefault(comment["parent_id"], []).append(comment["id"])
        return below

    @cached_property
    def archive(self) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
        """Posts and comments of a year before, which no listing reaches: dumps hold them,
        and info knows all but the last three posts.
        """
        past = Subreddit(self.seed + 1, 60, width=30, depth=12, name=self.name, domain=self.domain)
        posts, comments = {}, {}
        for post in past.posts.values():
            key, page = f"d{post['id']}", f"/r/{self.name}/comments/d{post['id']}/post/"
            posts[key] = {
                **post,
                "id": key,
                "name": f"t3_{key}",
                "permalink": page,
                "created_utc": post["created_utc"] - _YEAR,
                **({"url": f"https://www.reddit.com{page}"} if post["is_self"] else {}),
            }
        for comment in past.comments.values():
            key, parent = f"d{comment['id']}", comment["parent_id"]
            comments[key] = {
                **comment,
                "id": key,
                "name": f"t1_{key}",
                "link_id": f"t3_d{comment['link_id'][3:]}",
                "parent_id": f"{parent[:3]}d{parent[3:]}",
                "created_utc": comment["created_utc"] - _YEAR,
            }
        return posts, comments

    def shown(self, name: str) -> dict[str, Any] | None:
        """A post or comment as the service gives it now; None when it is gone."""
        if name in self.gone:
            return None
        kind, _, key = name.partition("_")
        data = (self.posts if kind == "t3" else self.comments).get(key)
        if data is None and key.startswith("d"):
            posts, comments = self.archive
            data = (
                None if key in list(posts)[-3:] else (posts if kind == "t3" else comments).get(key)
            )
        if data is None or name not in self.removed:
            return data
        return {
            **data,
            ("selftext" if kind == "t3" else "body"): "[removed]",
            "author": "[deleted]",
            **(
                {"removed_by_category": "moderator", "is_robot_indexable": False}
                if kind == "t3"
                else {}
            ),
        }

    def _post(self, number: int) -> dict[str, Any]:
        rng = clock.rng("subreddit", self.seed, number)
        key, made = _base36(40_000_000 + 7 * number), START + 3_600 * number
        speech, least = self.domain.speech, self.domain.min_score
        title = speech.post(rng)
        post: dict[str, Any] = {
            "id": key,
            "name": f"t3_{key}",
            "subreddit": self.name,
            "subreddit_name_prefixed": f"r/{self.name}",
            "title": title,
            "author": rng.choice(_PEOPLE),
            "author_fullname": f"t2_{_base36(9_000 + rng.randrange(900))}",
            "author_flair_text": None,
            "created_utc": float(made),
            "score": rng.randrange(least, least + 3_995),
            "upvote_ratio": round(rng.uniform(0.6, 1), 2),
            "num_comments": 0,
            "over_18": False,
            "is_self": True,
            "selftext": speech.about(rng, 2),
            "url": f"https://www.reddit.com/r/{self.name}/comments/{key}/post/",
            "permalink": f"/r/{self.name}/comments/{key}/post/",
            "domain": f"self.{self.name}",
            "is_video": False,
            "removed_by_category": None,
            "is_robot_indexable": True,
            "edited": False,
            "stickied": False,
            "distinguished": None,
            "media": None,
        }
        case = (
            CASES[number]
            if number < len(CASES)
            else rng.choices(
                ("text", "image", "link", "video_hosted", "gallery", "low_score"),
                (5, 6, 2, 2, 1, 3),
            )[0]
        )
        self._shape(post, case, rng)
        return post

    def _shape(self, post: dict[str, Any], case: str, rng: random.Random) -> None:
        key = post["id"]
        links = {
            "image": f"https://i.redd.it/{key}pic.png",
            "image_album": f"https://imgur.com/a/{key}",
            "image_direct": f"https://pictures.example/{key}.jpg",
            "video_hosted": f"https://v.redd.it/{key}",
            "video_youtube": f"https://www.youtube.com/watch?v={key}vid0",
            "video_gifv": f"https://i.imgur.com/{key}.gifv",
            "link": f"https://notes.example/{self.domain.speech.link_word(rng)}/{key}",
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
                    f"{key}{part}": {"status": "valid", "e": "Image", "m": "image/png"}
                    for part in "ab"
                },
            }
        elif case == "poll":
            post["poll_data"] = {
                "options": [
                    {"text": word, "id": str(n), "vote_count": 3 * n}
                    for n, word in enumerate(self.domain.words.poll)
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
            post["score"] = rng.randrange(0, max(1, self.domain.min_score))
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
            post["title"] = _RUDE[0].capitalize()
        elif case == "rude_body":
            post["selftext"] = _RUDE[1]
        elif case == "odd_text":
            post |= {
                "title": "A tower 🗼 مرحبا & <b>bold</b>",
                "selftext": "tab\tand\0nul and \ud83d alone",
            }
        elif case == "empty_text":
            post["selftext"] = ""

    def _thread(self, number: int, post: dict[str, Any]) -> list[dict[str, Any]]:
        rng = clock.rng("thread", self.seed, number)
        case = CASES[number] if number < len(CASES) else ""
        made: list[dict[str, Any]] = []
        if case == "deep":
            for _ in range(self.depth):
                made.append(self._comment(post, made[-1] if made else None, len(made), rng))
        elif case == "wide":
            for _ in range(self.width):
                made.append(self._comment(post, None, len(made), rng))
        else:
            for _ in range(rng.choice((0, 1, 2, 4, 7, 15))):
                made.append(
                    self._comment(
                        post,
                        rng.choice(made) if made and rng.random() < 0.6 else None,
                        len(made),
                        rng,
                    )
                )
        post["num_comments"] = len(made)
        return made

    def _comment(
        self, post: dict[str, Any], parent: dict[str, Any] | None, number: int, rng: random.Random
    ) -> dict[str, Any]:
        key = f"{post['id']}{_base36(number).rjust(3, '0')}"
        comment = {
            "id": key,
            "name": f"t1_{key}",
            "link_id": post["name"],
            "parent_id": parent["name"] if parent else post["name"],
            "subreddit": self.name,
            "author": rng.choice(_PEOPLE),
            "author_fullname": f"t2_{_base36(9_000 + rng.randrange(900))}",
            "body": self.domain.speech.about(rng, 1),
            "created_utc": post["created_utc"] + 60 * (number + 1),
            "score": rng.randrange(-3, 90),
            "edited": False,
            "stickied": False,
            "distinguished": None,
            "permalink": f"{post['permalink']}{key}/",
            "score_hidden": False,
            "depth": parent["depth"] + 1 if parent else 0,
            "replies": "",
        }
        roll = rng.random()
        if roll < 0.04:
            comment |= {"body": "[deleted]", "author": "[deleted]"}
        elif roll < 0.07:
            comment |= {"body": "[removed]", "author": "[deleted]"}
        elif roll < 0.12:
            comment["body"] = rng.choice(_RUDE)
        return comment


def _base36(number: int) -> str:
    digits = ""
    while number:
        number, rest = divmod(number, 36)
        digits = "0123456789abcdefghijklmnopqrstuvwxyz"[rest] + digits
    return digits or "0"
