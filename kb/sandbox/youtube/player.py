"""Makes the player's answer for a video: playability, streams and caption tracks.

It is written down in data/youtube/player.json.
"""

from functools import partial
from typing import Any
from urllib.parse import urlencode

from kb.sandbox.json_templates import written
from kb.sandbox.youtube.cases import Track
from kb.sandbox.youtube.catalogue import Video

SITE = "https://www.youtube.com"
NAMES = {
    "en": "English",
    "en-GB": "English (United Kingdom)",
    "en-US": "English (United States)",
    "de": "German",
    "es": "Spanish",
    "ja": "Japanese",
    "fr": "French",
    "ar": "Arabic",
}
# (itag, short edge of the frame)
LADDER = (
    (160, 144),
    (133, 240),
    (134, 360),
    (135, 480),
    (136, 720),
    (137, 1080),
    (400, 1440),
    (401, 2160),
)


_part = partial(written, "youtube/player.json")


def is_gone(video: Video) -> bool:
    """Whether nobody is shown the video any more."""
    return not video.in_api or video.player == "gone"


def player_answer(video: Video | None, key: str) -> dict[str, Any]:
    """The player's answer for a video; None or a vanished one is unavailable."""
    around = _part("around", {})
    if video is None or is_gone(video):
        return {**around, **_part("gone", {})}
    details = {
        "id": video.id,
        "title": video.title,
        "seconds": str(video.seconds),
        "tags": video.tags,
        "channel_id": video.channel.id,
        "description": video.description,
        "views": video.view_count or "0",
        "channel_title": video.channel.title,
        "live": video.live != "none",
    }
    values = {"details": _part("details", details)}
    if video.player == "age":
        return {**around, **_part("age", values)}
    captions = _captions(video) if video.tracks else None
    return {**around, **_part("plays", {**values, **_streams(video), "captions": captions})}


def signature(key: str) -> str:
    """The invented signature in a caption track's address."""
    return f"SANDBOX.{key}"


def _streams(video: Video) -> dict[str, Any]:
    """`whole` streams with sound, and `adaptive` ones of frames or sound alone."""
    short = min(video.width, video.height)
    values = {"id": video.id, "milliseconds": str(video.seconds * 1000 + 24)}

    def frames(edge: int) -> dict[str, Any]:
        width, height = round(video.width * edge / short), round(video.height * edge / short)
        fps = video.fps if edge >= 720 else min(video.fps, 30)
        return {**values, "width": width, "height": height, "fps": fps}

    adaptive = [
        _part("frames", {**frames(edge), "itag": itag, "edge": edge, "bitrate": edge * 2500})
        for itag, edge in reversed(LADDER)
        if edge <= short
    ]
    return {
        "whole": [_part("both", frames(360))],
        "adaptive": [*adaptive, _part("sound", values)],
    }


def _captions(video: Video) -> Any:
    languages = dict.fromkeys(("ar", "en", "fr", "de", "ja", "es", video.language))
    values = {
        "tracks": [_track(video, track) for track in video.tracks],
        "indices": list(range(len(video.tracks))),
        "languages": [
            _part("language", {"code": code, "name": NAMES.get(code, code)}) for code in languages
        ],
    }
    return _part("captions", values)


def _track(video: Video, track: Track) -> Any:
    query = {
        "v": video.id,
        "ei": "sandbox",
        "caps": "asr",
        "opi": "112496729",
        "hl": "en",
        "ip": "2001:db8::7",
        "ipbits": "0",
        "expire": "1893456000",
        "sparams": "ip,ipbits,expire,v,ei,caps,opi",
        "signature": signature(video.id),
        "key": "yt8",
        **({"kind": track.kind} if track.kind else {}),
        **({"exp": "xpe"} if track.po_token else {}),
    }
    automatic = " (auto-generated)" if track.kind else ""
    values = {
        "address": f"{SITE}/api/timedtext?{urlencode(query)}&lang={track.language}&fmt=srv3",
        "name": NAMES.get(track.language, track.language) + automatic,
        "mark": "a" if track.kind else "",
        "language": track.language,
        "kind": track.kind or None,
        "translatable": track.translatable,
    }
    return _part("track", values)
