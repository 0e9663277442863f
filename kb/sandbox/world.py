"""Holds one small invented world, the same for a seed on every machine.

Nothing in it was taken from a real site: channels, titles, descriptions and speech are put together
here from the nouns of a domain, the default profile's where none is given.
"""

from collections import Counter
from datetime import UTC, datetime, timedelta
from typing import Any

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.sandbox.domain import Domain, usual
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.youtube.catalogue import Catalogue


class World:
    """What the services show.

    `n_channels`, `n_videos`: size of the YouTube part (the first videos cover every case once, see
    kb/sandbox/youtube/cases.py). `n_posts`, `width`, `depth`: of Reddit's
    (kb/sandbox/reddit/subreddit.py).
    `n_pages`: how many of the wiki's pages are listed, by title; None for all. `n_named`: how many
    are about the domain's names (kb/sandbox/wiki/generated.py); None for as many as a domain needs
    that
    has no recorded ones.
    `wiki_state`: "first" or "later". `quota`: YouTube's units a Pacific day
    by bucket.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        n_channels: int = 12,
        n_videos: int = 300,
        n_posts: int = 240,
        width: int = 1_200,
        depth: int = 40,
        n_pages: int | None = None,
        n_named: int | None = None,
        wiki_state: str = "first",
        domain: Domain | None = None,
    ) -> None:
        self.domain = domain or usual()
        self.seed = seed
        self.n_channels = n_channels
        self.n_videos = n_videos
        self.n_posts, self.width, self.depth = n_posts, width, depth
        self.n_pages, self.n_named, self.wiki_state = n_pages, n_named, wiki_state
        self.quota = {"search": 100, "general": 10_000, "stats": 10_000}
        self.used: Counter[tuple[str, str]] = Counter()  # (Pacific day, bucket) -> units
        self.now: datetime | None = None  # None: the clock's own time

    @cached_property
    def youtube(self) -> Catalogue:
        """Channels and videos."""
        return Catalogue(self.seed, self.n_channels, self.n_videos, self.domain)

    @property
    def truth(self) -> dict[str, Any]:
        """What is planted in the videos, as plain values (kb/sandbox/youtube/planted.py)."""
        return self.youtube.truth

    @cached_property
    def reddit(self) -> Subreddit:
        """Posts and comments."""
        return Subreddit(
            self.seed, self.n_posts, width=self.width, depth=self.depth, domain=self.domain
        )

    def pacific_day(self) -> str:
        """Today where YouTube counts its quota, "2026-11-20"."""
        now = self.now or clock.now()
        return (now - timedelta(hours=7 if _summer_time(now) else 8)).date().isoformat()


def _summer_time(now: datetime) -> bool:
    """Whether US Pacific time is UTC-7: second Sunday of March 10:00 UTC to first Sunday of
    November 9:00 UTC.

    Reckoned here because a bare system has no time zone files.
    """

    def sunday(month: int, count: int, hour: int) -> datetime:
        first = datetime(now.year, month, 1, hour, tzinfo=UTC)
        return first + timedelta(days=(6 - first.weekday()) % 7 + 7 * (count - 1))

    return sunday(3, 2, 10) <= now < sunday(11, 1, 9)
