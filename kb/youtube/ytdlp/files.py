"""What a file of a yt-dlp folder is, by its name.

yt-dlp names files by a template that users change. Its default is `TITLE [ID].EXT`; `ID.EXT` is the
most frequent other one. Subtitle files have their language before the suffix.
"""

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

INFO = ".info.json"
UNFINISHED, OTHER, OTHER_SUBTITLES = "unfinished_downloads", "other_files", "other_subtitles"
VIDEO_ID = re.compile(r"[A-Za-z0-9_-]{11}")

_SUBTITLES = re.compile(
    r"(?P<stem>.+)\.(?P<language>[A-Za-z]{2,3}(?:-[A-Za-z0-9]+)*)\.(?P<format>vtt|srv3|json3)"
)
_IN_BRACKETS = re.compile(r"\[([A-Za-z0-9_-]{11})\]$")
_UNFINISHED = re.compile(r"\.(?:part|ytdl|part-Frag\d+|temp|temp\.[a-z0-9]+)$")
_MEDIA = re.compile(
    r".+\.(?:3gp|aac|avi|flac|flv|gif|jpe?g|m4[av]|mhtml|mk[av]|mov|mp[34]|og[gv]|opus|png|ts|wav"
    r"|web[amp])",
    re.IGNORECASE,
)
_TEXT_TRACKS = re.compile(r".+\.(?:ass|lrc|sbv|srt|srv[123]|ttml|vtt|json3)", re.IGNORECASE)


class SubtitleName(NamedTuple):
    """What the name of a subtitle file says; `video_id` is None where the name has none."""

    stem: str
    video_id: str | None
    language: str
    format: str


def subtitles(name: str) -> SubtitleName | None:
    """`TITLE [ID].en.vtt` in its parts; None for any other name."""
    match = _SUBTITLES.fullmatch(name)
    if match is None:
        return None
    stem = match["stem"]
    in_brackets = _IN_BRACKETS.search(stem)
    if in_brackets is not None:
        video_id: str | None = in_brackets[1]
    else:
        video_id = stem if VIDEO_ID.fullmatch(stem) else None
    return SubtitleName(stem, video_id, match["language"], match["format"])


def reason(name: str) -> str | None:
    """Why a file that is neither info nor subtitles is left out; None for media files, which
    belong there.
    """
    if _UNFINISHED.search(name):
        return UNFINISHED
    if _MEDIA.fullmatch(name):
        return None
    return OTHER_SUBTITLES if _TEXT_TRACKS.fullmatch(name) else OTHER


def walk(folders: Iterable[Path]) -> Iterator[os.DirEntry[str]]:
    """Every file below the folders, as the disk lists them: no folder is held in memory.

    Links to folders are not followed. A folder that can't be read is passed over.
    """
    waiting = [str(folder) for folder in folders]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    elif entry.is_file():
                        yield entry
        except (PermissionError, FileNotFoundError):
            continue
