"""What several packages need to know of videos: values of their columns that are compared with, and
the video that a file is about, by its name (films, subtitles, transcripts).
"""

import re

# What decided the topic of videos that are known to be about it: YouTube's label, or the profile,
# which takes imported videos as meant. `keywords` only make it likely.
BY_LABEL, BY_PROFILE, BY_KEYWORDS = "game_label", "profile", "keywords"
TOPIC_KNOWN = (BY_LABEL, BY_PROFILE)
# Who may see a video or playlist where that is not everybody, in the words of YouTube's API and of
# yt-dlp. The id of an unlisted one is its only lock, so it must not be given away.
NOT_PUBLIC = ("private", "unlisted", "needs_auth", "premium_only", "subscriber_only")


_STREAM = re.compile(r"\.f\d+(?:-\w+)?$")  # of one format, before yt-dlp joins them
_BRACKETS = re.compile(
    r"\[(?:youtube[-_= ])?([A-Za-z0-9_-]{11})\]$|\[(?:youtube[-_= ])?([^][]+)\]$", re.IGNORECASE
)
_BEHIND_TITLE = re.compile(r".+-([A-Za-z0-9_-]{11})", re.DOTALL)


def without_stream(stem: str) -> str:
    """`ID` of `ID.f137`."""
    return _STREAM.sub("", stem)


def possible_ids(stem: str) -> tuple[str, str, str]:
    """What may be the id in a name without its suffix: all of it (`ID`), what is in brackets
    (`TITLE [ID]`, yt-dlp's default) and what follows the title (`TITLE-ID`, youtube-dl's default,
    or the end of a title); "" where there is none.
    """
    inside, behind = _BRACKETS.search(stem), _BEHIND_TITLE.fullmatch(stem)
    return stem, inside[1] or inside[2] if inside else "", behind[1] if behind else ""
