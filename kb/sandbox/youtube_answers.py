"""Resources of the Data API v3, written field by field like the recorded answers.

Source: https://developers.google.com/youtube/v3/docs (search, channels, playlists, playlistItems,
videos).
"""

from __future__ import annotations

import hashlib
import html
from typing import Any

from kb.sandbox.videos import Channel, Video

_SIZES = {
    "default": (120, 90),
    "medium": (320, 180),
    "high": (480, 360),
    "standard": (640, 480),
    "maxres": (1280, 720),
}


def etag(*parts: object) -> str:
    """A made-up etag, the same for the same parts."""
    return hashlib.sha256(
        "\x1f".join(map(str, parts)).encode("utf-8", "surrogatepass")
    ).hexdigest()[:27]


def page(kind: str, items: list[Any], total: int, size: int, **tokens: str) -> dict[str, Any]:
    """A list answer around `items`."""
    return {
        "kind": f"youtube#{kind}ListResponse",
        "etag": etag(kind, total, *tokens.values()),
        **tokens,
        "pageInfo": {"totalResults": total, "resultsPerPage": size},
        "items": items,
    }


def search_hit(channel: Channel) -> dict[str, Any]:
    """A search result of type channel; titles are HTML-escaped here and nowhere else."""
    title, about = html.escape(channel.title), html.escape(channel.description[:160])
    return {
        "kind": "youtube#searchResult",
        "etag": etag("hit", channel.id),
        "id": {"kind": "youtube#channel", "channelId": channel.id},
        "snippet": {
            "publishedAt": channel.published_at,
            "channelId": channel.id,
            "title": title,
            "description": about,
            "thumbnails": {
                name: {"url": f"https://yt3.ggpht.com/sandbox/{channel.id}=s{size}"}
                for name, size in (("default", 88), ("medium", 240), ("high", 800))
            },
            "channelTitle": title,
            "liveBroadcastContent": "none",
            "publishTime": channel.published_at,
        },
    }


def channel_parts(channel: Channel) -> dict[str, Any]:
    """A channel by part."""
    text = {"title": channel.title, "description": channel.description}
    thumbnails = {
        name: {
            "url": f"https://yt3.ggpht.com/sandbox/{channel.id}=s{size}",
            "width": size,
            "height": size,
        }
        for name, size in (("default", 88), ("medium", 240), ("high", 800))
    }
    handle = "@" + "".join(filter(str.isalnum, channel.title)).lower()
    return {
        "snippet": {
            **text,
            "customUrl": handle,
            "publishedAt": channel.published_at,
            "thumbnails": thumbnails,
            "localized": text,
            "country": "US",
        },
        "contentDetails": {"relatedPlaylists": {"likes": "", "uploads": channel.uploads}},
        "statistics": {
            "viewCount": str(len(channel.videos) * 4711),
            "subscriberCount": str(len(channel.videos) * 100),
            "hiddenSubscriberCount": False,
            "videoCount": str(len(channel.videos)),
        },
        "brandingSettings": {"channel": {**text, "keywords": channel.words[:60]}},
    }


def playlist_parts(channel: Channel) -> dict[str, Any]:
    """The uploads playlist by part."""
    text = {"title": f"Uploads from {channel.title}", "description": ""}
    return {
        "snippet": {
            "publishedAt": channel.published_at,
            "channelId": channel.id,
            **text,
            "thumbnails": _thumbnails(channel.videos[0]) if channel.videos else {},
            "channelTitle": channel.title,
            "localized": text,
        },
        "status": {"privacyStatus": "public"},
        "contentDetails": {"itemCount": len(channel.entries)},
    }


def entry_parts(video: Video, playlist: str, position: int) -> dict[str, Any]:
    """A playlist item by part. What is no longer public says so and has lost all else."""
    gone = not video.in_api
    text = (
        {"title": "Private video", "description": "This video is private.", "thumbnails": {}}
        if gone
        else {
            "title": video.title,
            "description": video.description,
            "thumbnails": _thumbnails(video),
        }
    )
    owner = (
        {}
        if gone
        else {
            "videoOwnerChannelTitle": video.channel.title,
            "videoOwnerChannelId": video.channel.id,
        }
    )
    return {
        "snippet": {
            "publishedAt": video.published_at,
            "channelId": video.channel.id,
            **text,
            "channelTitle": video.channel.title,
            "playlistId": playlist,
            "position": position,
            "resourceId": {"kind": "youtube#video", "videoId": video.id},
            **owner,
        },
        "contentDetails": {"videoId": video.id}
        | ({} if gone else {"videoPublishedAt": video.published_at}),
        "status": {"privacyStatus": "private" if gone else "public"},
    }


def video_parts(video: Video, max_width: int | None, max_height: int | None) -> dict[str, Any]:
    """A video by part; hidden counts are absent."""
    text = {"title": video.title, "description": video.description}
    snippet: dict[str, Any] = {
        "publishedAt": video.published_at,
        "channelId": video.channel.id,
        **text,
        "thumbnails": _thumbnails(video),
        "channelTitle": video.channel.title,
        "tags": video.tags,
        "categoryId": video.category_id,
        "liveBroadcastContent": video.live,
        "localized": text,
        "defaultAudioLanguage": (video.tracks[0].language if video.tracks else "en"),
    }
    if not video.tags:
        del snippet["tags"]
    details: dict[str, Any] = {
        "duration": video.iso_duration,
        "dimension": "2d",
        "definition": "hd" if min(video.width, video.height) >= 720 else "sd",
        "caption": str(any(track.kind != "asr" for track in video.tracks)).lower(),
        "licensedContent": video.number % 3 == 0,
        "contentRating": {"ytRating": video.rating} if video.rating else {},
        "projection": "rectangular",
        "hasCustomThumbnail": True,
    }
    counts = {
        "viewCount": video.view_count,
        "likeCount": video.like_count,
        "favoriteCount": "0",
        "commentCount": video.comment_count,
    }
    player: dict[str, Any] = {
        "embedHtml": f'<iframe width="480" height="270" src="//www.youtube.com/embed/{video.id}"'
        ' frameborder="0"'
        ' allow="accelerometer; autoplay; encrypted-media"'
        ' referrerpolicy="strict-origin-when-cross-origin" allowfullscreen></iframe>'
    }
    if video.sized and (max_width or max_height):
        # The largest frame of the video's own shape that fits.
        scale = min((max_width or 10**9) / video.width, (max_height or 10**9) / video.height)
        player |= {
            "embedHeight": str(round(video.height * scale)),
            "embedWidth": str(round(video.width * scale)),
        }
    return {
        "snippet": snippet,
        "contentDetails": {name: value for name, value in details.items() if value is not None},
        "status": {
            "uploadStatus": "processed",
            "privacyStatus": "public",
            "license": video.license,
            "embeddable": True,
            "publicStatsViewable": True,
            "madeForKids": False,
        },
        "statistics": {name: value for name, value in counts.items() if value is not None},
        "player": player,
    }


def _thumbnails(video: Video) -> dict[str, Any]:
    names = {
        "default": "default",
        "medium": "mqdefault",
        "high": "hqdefault",
        "standard": "sddefault",
        "maxres": "maxresdefault",
    }
    return {
        name: {
            "url": f"https://i.ytimg.com/vi/{video.id}/{names[name]}.jpg",
            "width": width,
            "height": height,
        }
        for name, (width, height) in _SIZES.items()
        if name != "maxres" or video.number % 4
    }
