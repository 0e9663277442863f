"""Files of a yt-dlp folder: what each is, by its name; of an info.json what is kept of it, and the
rows that it makes.

yt-dlp names files by a template that users change. Its default is `TITLE [ID].EXT`; `ID.EXT` is the
most frequent other one. Subtitle files have their language before the suffix.

An info.json is full of signed addresses and holds the visitor's own; only the fields that
schemas/raw/youtube/ytdlp_info.json declares are kept, as they are in the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.languages import code_of, is_language, primary_language
from kb.crawl.file_text import json_value, text_of
from kb.schema import raw
from kb.schema.decode import ColumnReader
from kb.schema.tables import table
from kb.schema.video_facts import possible_ids
from kb.store.walk import walk
from kb.youtube.crawl import player

INFO = ".info.json"
UNFINISHED, OTHER_FILES, OTHER_SUBTITLES = "unfinished_downloads", "other_files", "other_subtitles"
WITHOUT_LANGUAGE = "without_language"  # subtitles, by a name that tells no language
VIDEO_ID = re.compile(r"[A-Za-z0-9_-]{11}")

_ANY_NAME = re.IGNORECASE | re.DOTALL  # names of files may hold line breaks
# Behind the language YouTube's id of a track with a name may stand.
_SUBTITLES = re.compile(
    r"(?P<stem>.+)\.(?P<language>[a-z]{2,3}(?:-[a-z0-9_-]+|_[a-z]{2}|_[a-z]{4})?|[a-z]{4,})"
    r"\.(?P<format>vtt|srv3|json3|srt)",
    _ANY_NAME,
)
_UNFINISHED = re.compile(r"\.(?:part|ytdl|part-Frag\d+|temp|temp\.[a-z0-9]+)\Z")
_MEDIA = re.compile(
    r".+\.(?:3gp|aac|avi|flac|flv|gif|jpe?g|m4[av]|mhtml|mk[av]|mov|mp[34]|og[gv]|opus|png|ts|wav"
    r"|web[amp])",
    _ANY_NAME,
)
_READ = re.compile(r".+\.(?:json3|srt|srv3|vtt)", _ANY_NAME)
_TEXT_TRACKS = re.compile(r".+\.(?:ass|lrc|sbv|srt|srv[123]|ttml|vtt|json3)", _ANY_NAME)


class SubtitleName(NamedTuple):
    """What the name of a subtitle file says; `video_id` is None where the name has none.

    `or_else` is what may be an id, or the end of a title.
    """

    stem: str
    video_id: str | None
    or_else: str | None
    language: str
    format: str


def subtitle_name(name: str) -> SubtitleName | None:
    """`TITLE [ID].en.vtt` or `TITLE [ID].English.vtt` in its parts; None for any other name."""
    match = _SUBTITLES.fullmatch(name)
    if match is None:
        return None
    language = match["language"]
    if len(language) > 3 and language.isalpha():  # English
        language = code_of(language)
    if not is_language(primary_language(language)):
        return None
    stem, in_brackets, behind = possible_ids(match["stem"])
    video_id = next(filter(VIDEO_ID.fullmatch, (in_brackets, stem)), None)
    if language.isupper():  # EN, EN-GB
        language = language[:3].lower() + language[3:]
    return SubtitleName(stem, video_id, behind or None, language, match["format"].lower())


# `ID.f140.m4a.en.json`: programs put their suffix behind that of the film or sound.
_OF_FILM = re.compile(
    r"(?:\.f\d+(?:-\w+)?)?"
    r"(?:\.(?:3gp|aac|avi|flac|flv|m4[av]|mk[av]|mov|mp[34]|og[gv]|opus|ts|wav|webm))?$",
    re.IGNORECASE,
)
_WORD = re.compile(r"[A-Za-z]?[a-z]{10}")  # no id: "transcripts", a folder


class OwnName(NamedTuple):
    """What the name of one's own transcript says: what may be the video's id, in the order in which
    films are found; which of them is one even if the video is unknown; the language.
    """

    ids: list[str]
    likely: str | None
    language: str | None
    format: str


def own_name(path: Path) -> OwnName | None:
    """`ID.json`, `TITLE [ID].en.srt` or `ID/…` in its parts; None for any other name."""
    form = path.suffix[1:].lower()
    if form not in ("json", "vtt", "srt") or path.name.endswith((INFO, ".live_chat.json")):
        return None
    stem, _, behind = path.stem.rpartition(".")
    language = code_of(behind) if stem and is_language(code_of(behind)) else None
    stem, in_brackets, behind = possible_ids(_OF_FILM.sub("", stem if language else path.stem))
    folder = path.parent.name
    ids = [*filter(VIDEO_ID.fullmatch, (stem, in_brackets, behind, folder))]
    named = (in_brackets, stem, "" if _WORD.fullmatch(folder) else folder)
    return OwnName(ids, next(filter(VIDEO_ID.fullmatch, named), None), language, form)


def left_out_as(name: str) -> str | None:
    """Why a file that is neither info nor subtitles is left out; None for media files, which
    belong there.
    """
    if _UNFINISHED.search(name):
        return UNFINISHED
    if _MEDIA.fullmatch(name):
        return None
    if _READ.fullmatch(name):
        return WITHOUT_LANGUAGE
    return OTHER_SUBTITLES if _TEXT_TRACKS.fullmatch(name) else OTHER_FILES


def entries_below(folder: Path, left_out: Collection[Path] = ()) -> Iterator[os.DirEntry[str]]:
    """Every file below a folder, in order. What is neither file nor folder, such as a FIFO or a
    link that leads nowhere or back, comes with them: whoever opens it says so.

    A folder that can't be read is passed over, as one of `left_out` (resolved) is.
    """
    for where, folders, others in walk(folder, strict=False):
        if left_out:
            folders[:] = [name for name in folders if (where / name).resolve() not in left_out]
        yield from others


def holds_info(path: Path) -> bool:
    """Whether this is a file that yt-dlp wrote, or a folder with one."""
    names = (entry.name for entry in entries_below(path)) if path.is_dir() else [path.name]
    return any(name.endswith(INFO) or subtitle_name(name) is not None for name in names)


LIVE_CHAT = "live_chat"  # yt-dlp lists it among the subtitles
# https://developers.google.com/youtube/v3/docs/videoCategories/list; yt-dlp gives names alone.
_CATEGORIES = {
    "Film & Animation": 1,
    "Autos & Vehicles": 2,
    "Music": 10,
    "Pets & Animals": 15,
    "Sports": 17,
    "Travel & Events": 19,
    "Gaming": 20,
    "People & Blogs": 22,
    "Comedy": 23,
    "Entertainment": 24,
    "News & Politics": 25,
    "Howto & Style": 26,
    "Education": 27,
    "Science & Technology": 28,
    "Nonprofits & Activism": 29,
    "Movies": 30,
    "Shows": 43,
    "Trailers": 44,
}
_LIVE = {
    "is_live": "live",
    "is_upcoming": "upcoming",
    "not_live": "none",
    "was_live": "none",
    "post_live": "none",
}


def read(data: bytes) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The videos and the playlists of YouTube in a file, as raw answers keep them; none in one of
    another site.

    Raises ValueError for what is no JSON object, cut off, or of YouTube with neither in it.
    """
    record = json_value(text_of(data))
    if not isinstance(record, dict):
        raise ValueError("no JSON object")  # noqa: TRY004 (a fact about the file)
    videos: list[dict[str, Any]] = []
    playlists: list[dict[str, Any]] = []
    _collect(record, videos, playlists)
    if not (videos or playlists) and _site(record) and _is_youtube(record):
        raise ValueError("no video of YouTube by its id and title, and no playlist")
    return videos, playlists


def _site(record: dict[str, Any]) -> str:
    """The program's name of the site, "" where it is not known."""
    return str(record.get("extractor_key") or record.get("ie_key") or record.get("extractor") or "")


def _is_youtube(record: dict[str, Any]) -> bool:
    """Whether the site is YouTube, or not known."""
    return not (site := _site(record)) or site.lower().startswith("youtube")


def _collect(
    record: dict[str, Any], videos: list[dict[str, Any]], playlists: list[dict[str, Any]]
) -> None:
    kind = record.get("_type") or "video"
    if not _is_youtube(record):
        return
    if kind in ("playlist", "multi_video"):
        given = record.get("entries")
        entries = [one for one in given if isinstance(one, dict)] if isinstance(given, list) else []
        own = _fields("ytdlp_playlists", "entries[]")
        listed = [_kept(one, own) for one in entries if _is_id(one.get("id"))]
        if isinstance(record.get("id"), str):
            playlists.append({**_kept(record, _fields("ytdlp_playlists")), "entries": listed})
        for one in entries:
            _collect(one, videos, playlists)
    elif kind == "video" and _is_id(record.get("id")) and "title" in record:
        videos.append(_video(record))


def _is_id(value: Any) -> bool:
    return isinstance(value, str) and VIDEO_ID.fullmatch(value) is not None


def _video(record: dict[str, Any]) -> dict[str, Any]:
    width, height, fps = player.largest_stream({"formats": record.get("formats")})
    if width is None and not player.is_storyboard(record):  # chosen for download
        width, height, fps = (record.get(name) for name in ("width", "height", "fps"))
    manual, automatic = record.get("subtitles"), record.get("automatic_captions")
    kept = {
        # Some versions write whole numbers as 30.0, and lengths in parts of a second.
        name: round(value)
        if isinstance(value, float) and (value.is_integer() or name == "duration")
        else value
        for name, value in _kept(record, _fields("ytdlp_info")).items()
    }
    return {
        **kept,
        "largest_stream": {"width": width, "height": height, "fps": fps},
        "lists_tracks": isinstance(manual, dict) and isinstance(automatic, dict),
        "manual_tracks": _languages(manual),
        "automatic_tracks": _languages(automatic),
    }


def _languages(tracks: Any) -> list[str]:
    return [name for name in tracks if name != LIVE_CHAT] if isinstance(tracks, dict) else []


def _kept(record: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: record[name] for name in names if name in record}


@cache
def _fields(kind: str, at: str = "") -> tuple[str, ...]:
    name = f"youtube/{kind}"
    declared = raw.at(name, at) if at else raw.raw(name)
    return tuple((declared or {})["properties"])


def read_at(record: dict[str, Any]) -> datetime | None:
    """When yt-dlp read a video or playlist: `epoch`."""
    epoch = record.get("epoch")
    if isinstance(epoch, bool) or not isinstance(epoch, (int, float)):
        return None
    return clock.since_1970(epoch)


# -- rows ------------------------------------------------------------------------------------------


def rows(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Envelopes of ytdlp_info → one row a video, with the columns of `answers.videos`.

    Null is what a file can't tell. Besides: the largest stream's width and height (px) and
    `stream_fps`; `lists_tracks`, `manual_tracks`, `automatic_tracks`.
    """
    for got, _ in ColumnReader(table("youtube/videos"), "ytdlp_info").tables(lines):
        yield _as_videos(got.filter(pc.is_valid(got["video_id"])))


def _as_videos(got: pa.Table) -> pa.Table:
    categories: list[Any] = got["categories"].to_pylist()
    statuses: list[Any] = got["live_status"].to_pylist()
    handle = pc.invert(pc.match_substring_regex(got["uploader_id"], r"^UC[A-Za-z0-9_-]{22}$"))
    uploader_id = pc.if_else(handle, pa.scalar(None, pa.string()), got["uploader_id"])
    own: dict[str, Any] = {
        "channel_id": pc.coalesce(got["channel_id"], uploader_id),
        "channel_title": pc.coalesce(got["channel_title"], got["uploader"]),
        "published_at": pc.coalesce(got["published_at"], _days(got["upload_date"])),
        "category_id": pa.array(
            [_CATEGORIES.get(str(next(iter(names or ()), ""))) for names in categories], pa.int64()
        ),
        "live_broadcast_content": pa.array([_LIVE.get(status) for status in statuses], pa.string()),
        # The standard licence has no name on the page, and neither has one that was not read.
        "license": pc.if_else(
            pc.match_substring(got["license_name"], "creative commons", ignore_case=True),
            "creativeCommon",
            pa.scalar(None, pa.string()),
        ),
        "yt_rating": pc.if_else(
            pc.greater_equal(got["age_limit"], 18), "ytAgeRestricted", pa.scalar(None, pa.string())
        ),
        "missing": pa.repeat(pa.scalar(False), got.num_rows),
    }
    done = (
        "uploader",
        "uploader_id",
        "upload_date",
        "categories",
        "live_status",
        "license_name",
        "age_limit",
        *own,
    )
    got = got.drop_columns([name for name in done if name in got.column_names])
    for name, column in own.items():
        got = got.append_column(name, column)
    declared = table("youtube/videos")
    for column in (*declared.columns, *declared.inputs):
        if column.source.kind == "videos" and column.name not in got.column_names:
            kind: Any = column.parsed.arrow()
            got = got.append_column(column.name, pa.nulls(got.num_rows, kind))
    return got


def _days(column: pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """Days as "20260131" → midnight UTC; null for anything else."""
    days: list[datetime | None] = []
    for text in column.to_pylist():
        try:
            days.append(datetime.strptime(text or "", "%Y%m%d").replace(tzinfo=UTC))
        except ValueError:
            days.append(None)
    return pa.array(days, pa.timestamp("us", "UTC"))
