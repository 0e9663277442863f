"""[youtube]: which channels are searched, which videos are kept."""

import re
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from kb.core.config.section import (
    FILL_IN,
    WARNING,
    Phrases,
    Remark,
    SourceSection,
    is_everyday,
    repeated_remarks,
)
from kb.core.languages import is_language, tag

# The assignable and the older ids of https://developers.google.com/youtube/v3/docs/videoCategories
_CATEGORIES = frozenset([1, 2, 10, 15, *range(17, 45)])
_NAMED_CATEGORIES = (
    "1 Film, 2 Autos, 10 Music, 15 Pets, 17 Sports, 19 Travel, 20 Gaming, 22 People, 23 Comedy,"
    " 24 Entertainment, 25 News, 26 Howto & Style, 27 Education, 28 Science & Technology"
)
_GAME = re.compile(r"UC[\w-]{22}")


def _known_language(code: str) -> str:
    if not is_language(code):
        raise ValueError(f"{code!r} is no code of a language, such as en, pt-BR or zh-Hant")
    return tag(code)


class YouTubeSection(SourceSection):
    """The YouTube part of a profile (MineDojo paper, data collection appendix: YouTube)."""

    table = "youtube"
    about = "YouTube: which channels are searched, which videos are kept"
    subject = "keywords"
    first = {
        "keywords": (
            "Searches that find channels: the domain's name, alone and with Guide …",
            ["{title}"],
        ),
        "playlist_keywords": (
            "Searches that find playlists, such as tutorials.",
            ["{title} Tutorial", "{title} Guide"],
        ),
        "category_ids": (f"YouTube categories of the domain: {_NAMED_CATEGORIES}.", [FILL_IN]),
    }

    keywords: Phrases = Field(min_length=1, description="searches that find channels")
    playlist_keywords: Phrases = Field(
        (), description="searches that find playlists, whose videos are read as those of channels"
    )
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
        description="result pages of 50 channels or playlists per keyword; the API returns about"
        " 500 at most",
    )
    uploads: Literal["all", "no_shorts"] = Field(
        "all", description="list every upload, or skip Shorts"
    )
    min_views: int = Field(
        100, ge=0, le=20_000_000_000, description="minimum views of a kept video"
    )
    min_aspect_ratio: float = Field(
        1.0, ge=0, le=10, description="minimum aspect ratio (width / height) of a video"
    )
    min_duration_s: float = Field(
        60, ge=0, le=43_200, description="minimum duration of a video, in seconds"
    )
    transcripts: Literal["required", "optional"] = Field(
        "required", description="whether a video without transcript is kept"
    )
    language: Annotated[str, AfterValidator(_known_language)] = Field(
        "en",
        description="language of the transcripts; with a region, such as pt-BR, its tracks come"
        " before those of others",
        examples=["en"],
    )
    translate: bool = Field(
        True, description="use YouTube's translation if there is no transcript in the language"
    )
    own_transcripts: Literal["fill", "prefer", "ignore"] = Field(
        "fill",
        description="transcripts of your own speech recognition: used where YouTube has none, used"
        " before YouTube's, or not used",
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

    @property
    def topic_is_known(self) -> bool:
        """Whether a label, or the profile, can tell that a video is about the topic."""
        return bool(self.game_ids) or self.imported_topic == "known"

    def remarks(self) -> Iterator[Remark]:
        yield from repeated_remarks("youtube.keywords", self.keywords)
        yield from repeated_remarks("youtube.playlist_keywords", self.playlist_keywords)
        yield from repeated_remarks("youtube.topic_keywords", self.topic_keywords)
        key = "youtube.topic_keywords" if self.topic_keywords else "youtube.keywords"
        for word in filter(is_everyday, dict.fromkeys(self.words)):
            fix = (
                "every video of the categories with it counts as on topic;"
                " name what only your domain says in youtube.topic_keywords"
            )
            yield WARNING, key, f"'{key}' contains the everyday word \"{word}\"", fix
        for number in self.category_ids:
            if number not in _CATEGORIES:
                what = f"'youtube.category_ids' contains {number}, which is not a YouTube category"
                fix = "such as 20 Gaming, 26 Howto, 28 Science"
                yield WARNING, "youtube.category_ids", what, fix
        for game in self.game_ids:
            if not _GAME.fullmatch(game):
                what = f"'youtube.game_ids' contains \"{game}\", which is not a browse id"
                yield WARNING, "youtube.game_ids", what, "it begins with UC and has 24 characters"
        if self.max_age_days > 30:
            what = f"'youtube.max_age_days' is {self.max_age_days}"
            fix = "the API's terms ask to read data again, or remove it, after 30 days"
            yield WARNING, "youtube.max_age_days", what, fix
        if self.min_aspect_ratio > 1.78:
            what = f"'youtube.min_aspect_ratio' is {self.min_aspect_ratio:g}"
            yield (
                WARNING,
                "youtube.min_aspect_ratio",
                what,
                "wide-screen is 1.78: hardly any video passes",
            )
