"""The video that a file is about, by its name: of films, of subtitles, of transcripts."""

import re

_STREAM = re.compile(r"\.f\d+(?:-\w+)?$")  # of one format, before yt-dlp joins them
_BRACKETS = re.compile(
    r"\[(?:youtube[-_= ])?([A-Za-z0-9_-]{11})\]$|\[(?:youtube[-_= ])?([^][]+)\]$", re.IGNORECASE
)
_BEHIND_TITLE = re.compile(r".+-([A-Za-z0-9_-]{11})")


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
