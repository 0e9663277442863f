"""The player's answer of the sandbox's YouTube: is it playable, its streams, its caption tracks."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlencode

from kb.sandbox.cases import Track
from kb.sandbox.videos import Video

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


def player_answer(video: Video | None, key: str) -> dict[str, Any]:
    """The player's answer for a video; None or a vanished one is unavailable."""
    if video is None or not video.in_api or video.player == "gone":
        reason = "This video is unavailable"
        return {
            **_around(),
            "playabilityStatus": {
                "status": "ERROR",
                "reason": reason,
                "contextParams": "Q0FBU0FnZ0E=",
                "errorScreen": {
                    "playerErrorMessageRenderer": {
                        "reason": {"runs": [{"text": reason}]},
                        "icon": {"iconType": "ERROR_OUTLINE"},
                    }
                },
            },
        }
    details = {
        "videoId": video.id,
        "title": video.title,
        "lengthSeconds": str(video.seconds),
        "keywords": video.tags,
        "channelId": video.channel.id,
        "isOwnerViewing": False,
        "shortDescription": video.description,
        "isCrawlable": True,
        "thumbnail": {"thumbnails": []},
        "allowRatings": True,
        "viewCount": video.view_count or "0",
        "author": video.channel.title,
        "isPrivate": False,
        "isUnpluggedCorpus": False,
        "isLiveContent": video.live != "none",
    }
    if video.player == "age":
        return {
            **_around(),
            "videoDetails": details,
            "playabilityStatus": {
                "status": "LOGIN_REQUIRED",
                "reason": "This video may be inappropriate for some users.",
                "desktopLegacyAgeGateReason": 1,
                "reasonTitle": "You must sign in to view this video",
                "contextParams": "Q0FFU0FnZ0I=",
            },
        }
    answer = {
        **_around(),
        "playabilityStatus": {
            "status": "OK",
            "playableInEmbed": True,
            "contextParams": "Q0FFU0FnZ0M=",
        },
        "streamingData": _streams(video),
        "videoDetails": details,
    }
    if video.tracks:
        answer["captions"] = {"playerCaptionsTracklistRenderer": _captions(video)}
    return answer


def signature(key: str) -> str:
    """The invented signature in a caption track's address."""
    return f"SANDBOX.{key}"


def _around() -> dict[str, Any]:
    return {
        "responseContext": {
            "visitorData": "Q2dzU2FuZGJveA%3D%3D",
            "serviceTrackingParams": [
                {
                    "service": "GFEEDBACK",
                    "params": [
                        {"key": "is_viewed_live", "value": "False"},
                        {"key": "logged_in", "value": "0"},
                    ],
                }
            ],
        },
        "trackingParams": "CAAQu2kiEwi=",
        "frameworkUpdates": {"entityBatchUpdate": {"timestamp": {"seconds": "0", "nanos": 0}}},
    }


def _streams(video: Video) -> dict[str, Any]:
    short, whole = (
        min(video.width, video.height),
        {"approxDurationMs": str(video.seconds * 1000 + 24), "projectionType": "RECTANGULAR"},
    )
    address = f"https://rr4---sn-sandbox.googlevideo.com/videoplayback?ip=2001:db8::7&id={video.id}&signature=SANDBOX"
    adaptive = []
    for itag, edge in reversed(LADDER):
        if edge <= short:
            width, height = round(video.width * edge / short), round(video.height * edge / short)
            adaptive.append(
                {
                    "itag": itag,
                    "url": address,
                    "mimeType": 'video/mp4; codecs="avc1.64001f"',
                    "bitrate": edge * 2500,
                    "width": width,
                    "height": height,
                    "quality": f"hd{edge}",
                    "fps": video.fps if edge >= 720 else min(video.fps, 30),
                    "qualityLabel": f"{edge}p",
                    **whole,
                }
            )
    adaptive.append(
        {
            "itag": 140,
            "url": address,
            "mimeType": 'audio/mp4; codecs="mp4a.40.2"',
            "bitrate": 130_000,
            "quality": "tiny",
            "audioQuality": "AUDIO_QUALITY_MEDIUM",
            "audioSampleRate": "44100",
            "audioChannels": 2,
            **whole,
        }
    )
    small = {
        "itag": 18,
        "url": address,
        "mimeType": 'video/mp4; codecs="avc1.42001E, mp4a.40.2"',
        "bitrate": 219_300,
        "width": round(video.width * 360 / short),
        "height": round(video.height * 360 / short),
        "quality": "medium",
        "fps": min(video.fps, 30),
        "qualityLabel": "360p",
        **whole,
    }
    return {"expiresInSeconds": "21540", "formats": [small], "adaptiveFormats": adaptive}


def _captions(video: Video) -> dict[str, Any]:
    tracks = []
    for track in video.tracks:
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
        }
        if track.kind:
            query["kind"] = track.kind
        tracks.append(
            {
                "baseUrl": (
                    f"{SITE}/api/timedtext?{urlencode(query)}&lang={track.language}&fmt=srv3"
                ),
                "name": {"runs": [{"text": _name(track)}]},
                "vssId": ("a." if track.kind else ".") + track.language,
                "languageCode": track.language,
                **({"kind": track.kind} if track.kind else {}),
                "isTranslatable": track.translatable,
                "trackName": "",
            }
        )
    return {
        "captionTracks": tracks,
        "audioTracks": [{"captionTrackIndices": list(range(len(tracks))), "hasDefaultTrack": True}],
        "translationLanguages": [
            {"languageCode": code, "languageName": {"runs": [{"text": NAMES.get(code, code)}]}}
            for code in dict.fromkeys(("ar", "en", "fr", "de", "ja", "es", video.language))
        ],
        "defaultAudioTrackIndex": 0,
    }


def _name(track: Track) -> str:
    return NAMES.get(track.language, track.language) + (" (auto-generated)" if track.kind else "")
