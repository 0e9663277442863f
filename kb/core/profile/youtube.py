"""[youtube]: which channels are searched, which videos are kept."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from kb.core.profile.base import Section


class YouTubeSection(Section):
    """The YouTube part of a profile (MineDojo paper, data collection appendix: YouTube)."""

    table = "youtube"
    about = "YouTube: which channels are searched, which videos are kept"

    keywords: tuple[str, ...] = Field(min_length=1, description="searches that find channels")
    topic_keywords: tuple[str, ...] = Field(
        (),
        description="whole words that show the topic where no label does; default: keywords",
    )
    game_ids: tuple[str, ...] = Field(
        (), description="browse ids of the topic's label on watch pages, where YouTube has one"
    )
    category_ids: tuple[int, ...] = Field(
        min_length=1, description="YouTube categories of the topic (20 is Gaming)"
    )
    search_pages: int = Field(
        10,
        ge=1,
        le=10,
        description="result pages of 50 channels a keyword; the API ends at about 500",
    )
    uploads: Literal["all", "no_shorts"] = Field(
        "all", description="list every upload, or skip Shorts"
    )
    min_views: int = Field(100, ge=0, description="fewest views of a video that is kept")
    min_aspect_ratio: float = Field(1.0, ge=0, description="smallest width / height of a video")
    min_duration_s: float = Field(60, ge=0, description="shortest video, in seconds")
    transcripts: Literal["required", "optional"] = Field(
        "required", description="whether a video without transcript is kept"
    )
    language: str = Field(
        "en", pattern=r"^[a-z]{2,3}$", description="language of the transcripts", examples=["en"]
    )
    translate: bool = Field(
        True, description="take YouTube's translation where there is no transcript in the language"
    )
    transcripts_per_hour: float = Field(
        300, gt=0, description="politeness towards the public site: videos an hour"
    )
    max_age_days: int = Field(
        30, ge=1, description="API data older than this is read again by `kb refresh youtube`"
    )
    max_tries: int = Field(
        5, ge=1, le=20, description="tries of one request before its item counts as failed"
    )
    units_per_day: int = Field(10_000, ge=1, description="quota of the general bucket, in units")
    searches_per_day: int = Field(100, ge=1, description="quota of the search bucket, in searches")

    @field_validator("keywords", "topic_keywords")
    @classmethod
    def _words(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if any(not word.strip() for word in value):
            raise ValueError("holds an empty keyword")
        return value

    @property
    def words(self) -> tuple[str, ...]:
        """Whole words or phrases that show the topic."""
        return self.topic_keywords or self.keywords
