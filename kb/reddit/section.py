"""[reddit]: which posts are kept, what their links show."""

from collections.abc import Iterator, Mapping
from typing import Literal, get_args

from pydantic import Field

from kb.core.config.section import (
    FILL_IN,
    WARNING,
    Remark,
    Section,
    SourceSection,
    host_remarks,
    repeated_remarks,
)

Listing = Literal["new", "top", "controversial", "hot", "rising"]
Span = Literal["all", "year", "month", "week", "day", "hour"]


class Links(Section):
    """How the address of a link post tells what it shows. Endings decide first, then hosts.

    A host counts with its subdomains `www`, `m`, `old`, `new` and `i`. `video_paths` are sites
    where only some pages are videos: the path starts with one of these.
    """

    image_endings: tuple[str, ...] = Field(
        ("jpg", "jpeg", "png", "gif", "webp", "bmp"), description="file endings of images"
    )
    video_endings: tuple[str, ...] = Field(
        ("gifv", "mp4", "webm", "mov"), description="file endings of videos"
    )
    image_hosts: tuple[str, ...] = Field(
        ("i.redd.it", "preview.redd.it", "i.reddituploads.com", "imgur.com"),
        description="image hosts",
    )
    video_hosts: tuple[str, ...] = Field(
        ("v.redd.it", "streamable.com", "gfycat.com"), description="video hosts"
    )
    video_paths: dict[str, tuple[str, ...]] = Field(
        default_factory=dict, description="path prefixes of videos, by host"
    )


class RedditSection(SourceSection):
    """The Reddit part of a profile (MineDojo paper, data collection appendix: Reddit)."""

    table = "reddit"
    about = "Reddit: which posts are kept, what their links show"
    subject = "subreddit"
    first = {"subreddit": ("The subreddit, without r/.", FILL_IN)}

    subreddit: str = Field(
        # reddit.com is the subreddit of everything that was posted in 2005
        pattern=r"^([A-Za-z0-9_]{2,21}|[Rr]eddit\.com)$",
        description="name without r/",
        examples=["Minecraft"],
    )
    search: tuple[str, ...] = Field(
        (), description="search terms in the subreddit, besides its listings"
    )
    listings: tuple[Listing, ...] = Field(get_args(Listing), description="listings to read")
    spans: tuple[Span, ...] = Field(
        get_args(Span), description="time spans of top and controversial"
    )
    min_score: int = Field(5, le=1_000_000, description="minimum score of a kept post")
    links: Links = Links()
    max_age_days: int = Field(
        30, ge=1, description="live figures older than this are re-read by `kb refresh reddit`"
    )
    requests_per_minute: float = Field(
        100, gt=0, description="maximum requests per minute to the public service"
    )
    max_tries: int = Field(
        5, ge=1, le=20, description="attempts per request before its items count as failed"
    )

    def other_service(self, noted: Mapping[str, str]) -> str:
        subreddit = noted.get("subreddit", "")
        same = subreddit in ("", self.subreddit.lower())
        return "" if same else f"subreddit {subreddit}"

    def remarks(self) -> Iterator[Remark]:
        links = self.links
        yield from host_remarks("reddit.links.image_hosts", links.image_hosts)
        yield from host_remarks("reddit.links.video_hosts", links.video_hosts)
        for name in ("image_endings", "video_endings"):
            for ending in getattr(links, name):
                if ending != (plain := ending.lower().lstrip(".")):
                    key = f"reddit.links.{name}"
                    yield WARNING, key, f"'{key}' contains \"{ending}\"", f'write it as "{plain}"'
        yield from repeated_remarks("reddit.search", self.search)
