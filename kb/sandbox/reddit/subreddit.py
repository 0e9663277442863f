"""Generates the invented subreddit: posts of every kind with comments, as Reddit's API has them.

The first posts cover every case once (CASES); the rest are ordinary. Insults are our own words
for the sandbox's toxicity model. Times are fixed, so that the same seed gives the same world.
"""

import random
import re
from functools import partial
from typing import Any

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.sandbox.domain import Domain, usual
from kb.sandbox.invented_ids import ELSEWHERE, PEOPLE, comment_id, person_id, post_id, video_id
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


START = 1_700_000_000  # 2023-11-14
_YEAR = 31_536_000


class Subreddit:
    """`posts` and `comments` by bare id.

    `n_posts` in all; `width` replies below the "wide" post, `depth` below the "deep" one.
    `archived`: of a year before.
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
        archived: bool = False,
    ) -> None:
        self.archived = archived
        self.seed, self.n_posts, self.width, self.depth = seed, n_posts, width, depth
        self.domain = domain or usual()
        self.name = name or self.domain.subreddit
        self.room = 1_000  # requests in ten minutes, of whoever asks
        self.gone: set[str] = set()  # full names that the service no longer knows
        self.removed: set[str] = set()  # full names whose content moderators took down

    @cached_property
    def posts(self) -> dict[str, dict[str, Any]]:
        """Posts, oldest first, with the number of their comments from the first answer on."""
        posts = {post["id"]: post for post in (self._post(n) for n in range(self.n_posts))}
        self._threads = [self._thread(number, post) for number, post in enumerate(posts.values())]
        return posts

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
        past = Subreddit(
            self.seed + 1,
            60,
            width=30,
            depth=12,
            name=self.name,
            domain=self.domain,
            archived=True,
        )
        return past.posts, past.comments

    def shown(self, name: str) -> dict[str, Any] | None:
        """A post or comment as the service gives it now; None when it is gone."""
        if name in self.gone:
            return None
        kind, _, key = name.partition("_")
        data = (self.posts if kind == "t3" else self.comments).get(key)
        if data is None:
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
        key, made = post_id(40_000_000 + 7 * number, self.archived), START + 3_600 * number
        made -= _YEAR if self.archived else 0
        speech, least = self.domain.speech, self.domain.min_score
        cast = self._cast(number)
        title = speech.text("post", rng, cast)
        post: dict[str, Any] = {
            "id": key,
            "name": f"t3_{key}",
            "subreddit": self.name,
            "subreddit_name_prefixed": f"r/{self.name}",
            "title": title,
            "author": rng.choice(PEOPLE),
            "author_fullname": f"t2_{person_id(rng)}",
            "author_flair_text": None,
            "created_utc": float(made),
            "score": rng.randrange(least, least + 3_995),
            "upvote_ratio": round(rng.uniform(0.6, 1), 2),
            "num_comments": 0,
            "over_18": False,
            "is_self": True,
            "selftext": speech.text("post_body", rng, cast, rng.randint(1, 4)),
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
        shape(post, case, self.domain, cast, rng)
        return post

    def _cast(self, number: int) -> Cast:
        return self.domain.speech.cast(clock.rng("thread of", self.seed, number))

    def _thread(self, number: int, post: dict[str, Any]) -> list[dict[str, Any]]:
        rng = clock.rng("thread", self.seed, number)
        case = CASES[number] if number < len(CASES) else ""
        made: list[dict[str, Any]] = []
        cast = self._cast(number)
        if case == "deep":
            for _ in range(self.depth):
                made.append(self._comment(post, made[-1] if made else None, len(made), rng, cast))
        elif case == "wide":
            for _ in range(self.width):
                made.append(self._comment(post, None, len(made), rng, cast))
        else:
            for _ in range(rng.choice((0, 1, 2, 4, 7, 15))):
                made.append(
                    self._comment(
                        post,
                        rng.choice(made) if made and rng.random() < 0.6 else None,
                        len(made),
                        rng,
                        cast,
                    )
                )
        post["num_comments"] = len(made)
        return made

    def _comment(
        self,
        post: dict[str, Any],
        parent: dict[str, Any] | None,
        number: int,
        rng: random.Random,
        cast: Cast,
    ) -> dict[str, Any]:
        key = comment_id(post["id"], number)
        comment = {
            "id": key,
            "name": f"t1_{key}",
            "link_id": post["name"],
            "parent_id": parent["name"] if parent else post["name"],
            "subreddit": self.name,
            "author": rng.choice(PEOPLE),
            "author_fullname": f"t2_{person_id(rng)}",
            "body": self.domain.speech.text("reply" if parent else "comment", rng, cast),
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
            comment["body"] = rng.choice(RUDE)
        return comment
