"""[youtube]: which channels are searched, which videos are kept."""

from typing import Literal

from pydantic import Field

from kb.core.config.profile.base import Phrases, Section

# What decided the topic of videos that are known to be about it: YouTube's label, or the profile,
# which takes imported videos as meant. `keywords` only make it likely.
BY_LABEL, BY_PROFILE, BY_KEYWORDS = "game_label", "profile", "keywords"
TOPIC_KNOWN = (BY_LABEL, BY_PROFILE)


class YouTubeSection(Section):
    """The YouTube part of a profile (MineDojo paper, data collection appendix: YouTube)."""

    table = "youtube"
    about = "YouTube: which channels are searched, which videos are kept"

    keywords: Phrases = Field(min_length=1, description="searches that find channels")
    topic_keywords: Phrases = Field(
        (),
        description="whole words that indicate the topic without a label; default: keywords",
    )
    game_ids: tuple[str, ...] = Field(
        (), description="browse ids of the topic's label on watch pages, if YouTube has one"
    )
    category_ids: tuple[int, ...] = Field(
        min_length=1, description="YouTube categories of the topic (20 is Gaming)"
    )
    imported_topic: Literal["label", "known"] = Field(
        "label",
        description="whether videos of imported files are judged as others are, by label or"
        " category and keywords, or are known to be about the topic",
    )
    search_pages: int = Field(
        10,
        ge=1,
        le=10,
        description="result pages of 50 channels per keyword; the API returns about 500 at most",
    )
    uploads: Literal["all", "no_shorts"] = Field(
        "all", description="list every upload, or skip Shorts"
    )
    min_views: int = Field(100, ge=0, description="minimum views of a kept video")
    min_aspect_ratio: float = Field(
        1.0, ge=0, description="minimum aspect ratio (width / height) of a video"
    )
    min_duration_s: float = Field(60, ge=0, description="minimum duration of a video, in seconds")
    transcripts: Literal["required", "optional"] = Field(
        "required", description="whether a video without transcript is kept"
    )
    language: str = Field(
        "en", pattern=r"^[a-z]{2,3}$", description="language of the transcripts", examples=["en"]
    )
    translate: bool = Field(
        True, description="use YouTube's translation if there is no transcript in the language"
    )
    transcripts_per_hour: float = Field(
        300, gt=0, description="maximum videos per hour from the public site"
    )
    max_age_days: int = Field(
        30, ge=1, description="API data older than this is re-read by `kb refresh youtube`"
    )
    max_tries: int = Field(
        5, ge=1, le=20, description="attempts per request before its item counts as failed"
    )
    units_per_day: int = Field(10_000, ge=1, description="quota of the general bucket, in units")
    searches_per_day: int = Field(100, ge=1, description="quota of the search bucket, in searches")

    @property
    def words(self) -> tuple[str, ...]:
        """Whole words or phrases that show the topic."""
        return self.topic_keywords or self.keywords
