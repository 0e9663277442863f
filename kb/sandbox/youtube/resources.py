"""Makes resources and errors of the Data API v3 from templates in data/youtube/.

Source: https://developers.google.com/youtube/v3/docs (search, channels, playlists, playlistItems,
videos).
"""

import hashlib
import html
from functools import partial
from typing import Any

from kb.sandbox.json_templates import written
from kb.sandbox.youtube.uploads import Channel, Video

_resource = partial(written, "youtube/resources.json")


def etag(*parts: object) -> str:
    """A made-up etag, the same for the same parts."""
    return hashlib.sha256(
        "\x1f".join(map(str, parts)).encode("utf-8", "surrogatepass")
    ).hexdigest()[:27]


def page(kind: str, items: list[Any], total: int, size: int, **tokens: str) -> dict[str, Any]:
    """A list answer around `items`; `tokens` are nextPageToken and prevPageToken."""
    values = {
        "kind": kind,
        "etag": etag(kind, total, *tokens.values()),
        "next": tokens.get("nextPageToken"),
        "previous": tokens.get("prevPageToken"),
        "total": total,
        "size": size,
        "items": items,
    }
    return dict(_resource("page", values))


def search_hit(channel: Channel) -> dict[str, Any]:
    """A search result of type channel; titles are HTML-escaped here and nowhere else."""
    values = {
        "etag": etag("hit", channel.id),
        "id": channel.id,
        "published_at": channel.published_at,
        "title": html.escape(channel.title),
        "description": html.escape(channel.description[:160]),
    }
    return dict(_resource("search_hit", values))


def entry_parts(video: Video, playlist: str, position: int) -> dict[str, Any]:
    """A playlist item by part. What is no longer public says so and has lost all else."""
    values = {**_of(video), "playlist": playlist, "position": position}
    return dict(_resource("entry" if video.in_api else "entry_private", values))


def video_parts(video: Video, max_width: int | None, max_height: int | None) -> dict[str, Any]:
    """A video by part; hidden counts are absent."""
    values = {
        **_of(video),
        "tags": video.tags or None,
        "category_id": video.category_id,
        "live": video.live,
        "language": video.tracks[0].language if video.tracks else "en",
        "duration": video.iso_duration,
        "definition": "hd" if min(video.width, video.height) >= 720 else "sd",
        "caption": str(any(track.kind != "asr" for track in video.tracks)).lower(),
        "licensed": video.number % 3 == 0,
        "rating": {"ytRating": video.rating} if video.rating else {},
        "license": video.license,
        "view_count": video.view_count,
        "like_count": video.like_count,
        "comment_count": video.comment_count,
        "embed_width": None,
        "embed_height": None,
    }
    if video.sized and (max_width or max_height):
        # The largest frame of the video's own shape that fits.
        scale = min((max_width or 10**9) / video.width, (max_height or 10**9) / video.height)
        values["embed_width"] = str(round(video.width * scale))
        values["embed_height"] = str(round(video.height * scale))
    return dict(_resource("video", values))


def _of(video: Video) -> dict[str, Any]:
    return {
        "id": video.id,
        "title": video.title,
        "description": video.description,
        "published_at": video.published_at,
        "channel_id": video.channel.id,
        "channel_title": video.channel.title,
        "thumbnails": _thumbnails(video),
    }


def _thumbnails(video: Video) -> dict[str, Any]:
    thumbnails = dict(_resource("thumbnails", {"id": video.id}))
    if video.number % 4 == 0:
        del thumbnails["maxres"]  # not every video has one
    return thumbnails


Answer = tuple[int, dict[str, Any]]


def refusal(name: str, value: object = "") -> Answer:
    """A recorded error answer by its name in errors.json, with `value` in its text."""
    answer = written("youtube/errors.json", name, {"value": str(value)})
    return answer["status"], answer["response"]
