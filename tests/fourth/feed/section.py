"""[feed]: where the feed is, which notes are kept."""

from pydantic import Field

from kb.core.config.section import Section


class FeedSection(Section):
    """The feed part of a profile."""

    table = "feed"
    about = "Feed: where it is, which notes are kept"

    url: str = Field(description="address of the feed")
    min_likes: int = Field(1, ge=0, description="fewest likes of a note that is kept")
