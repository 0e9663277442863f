"""Posts and comments as passages; a comment has its post's title."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from kb.core.config.profile import Profile
from kb.reddit.section import RedditSection
from kb.search.passage import Passage, day, pieces, plain, rows
from kb.store.tables.merge import RowsByKey

_POST = ["post_id", "title", "body", "poll_options", "created_utc"]
_COMMENT = ["comment_id", "post_id", "body", "created_utc"]


def passages(profile: Profile, root: Path) -> Iterator[Passage]:
    """The passages of all kept threads, by post. Raises DamagedData."""
    subreddit = profile.section(RedditSection).subreddit
    replies = RowsByKey(rows(root, "reddit/comments", _COMMENT), "post_id")
    for post in rows(root, "reddit/posts", _POST):
        key, title = post["post_id"], plain(post["title"])
        url = f"https://www.reddit.com/r/{subreddit}/comments/{key}/"
        made = partial(Passage, thing=key, title=title)
        lines = [*plain(post["body"]).splitlines(), *map(plain, post["poll_options"] or ())]
        for text in list(pieces(lines)) or [""]:
            yield made("post", key=f"t3_{key}", text=text, url=url, date=day(post["created_utc"]))
        for comment in replies.rows_of(key):
            there, when = f"{url}_/{comment['comment_id']}/", day(comment["created_utc"])
            for text in pieces(plain(comment["body"]).splitlines()):
                name = f"t1_{comment['comment_id']}"
                yield made("comment", key=name, text=text, url=there, date=when)
