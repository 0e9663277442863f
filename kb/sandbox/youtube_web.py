"""The web side of the sandbox's YouTube: watch page, player answer and timed text.

In the form that youtube-transcript-api reads: the page gives a key, the player answer (asked with that key) the
caption tracks, a track's address the text. Lighter than the real ones (160 KB compressed), same places.
"""

from __future__ import annotations

import html
import json
from typing import Any
from urllib.parse import urlencode

from werkzeug.wrappers import Request, Response

from kb.sandbox.cases import Track
from kb.sandbox.videos import GAMES, Video
from kb.sandbox.world import World

PAGE_KEY = "sandbox_page_key"  # every page shows it; the player wants it back
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
LADDER = ((160, 144), (133, 240), (134, 360), (135, 480), (136, 720), (137, 1080), (400, 1440), (401, 2160))


class Web:
    """The web site over a world."""

    def __init__(self, world: World) -> None:
        self.world = world

    def answer(self, request: Request) -> Response:
        """One request of a browser, or of something like one."""
        if request.path == "/watch":
            return self._watch(request)
        if request.path == "/youtubei/v1/player" and request.method == "POST":
            return self._player(request)
        if request.path == "/api/timedtext":
            return self._timed_text(request)
        return Response("<!DOCTYPE html><title>404 Not Found</title>", 404, mimetype="text/html")

    def _watch(self, request: Request) -> Response:
        key = request.args.get("v", "")
        request.environ["sandbox.about"] = key
        return Response(watch_page(self.world.youtube.videos.get(key), key), mimetype="text/html")

    def _player(self, request: Request) -> Response:
        body = request.get_json(silent=True) or {}
        key = body.get("videoId", "")
        request.environ["sandbox.about"] = key
        if request.args.get("key") != PAGE_KEY:
            return Response(
                json.dumps(
                    {
                        "error": {
                            "code": 400,
                            "message": "API key not valid. Please pass a valid API key.",
                            "status": "INVALID_ARGUMENT",
                        }
                    }
                ),
                400,
                mimetype="application/json",
            )
        if "client" not in body.get("context", {}):
            return Response(
                json.dumps(
                    {
                        "error": {
                            "code": 400,
                            "message": "Request contains an invalid argument.",
                            "status": "INVALID_ARGUMENT",
                        }
                    }
                ),
                400,
                mimetype="application/json",
            )
        return Response(json.dumps(player_answer(self.world.youtube.videos.get(key), key)), mimetype="application/json")

    def _timed_text(self, request: Request) -> Response:
        key = request.args.get("v", "")
        request.environ["sandbox.about"] = key
        video = self.world.youtube.videos.get(key)
        wanted = (request.args.get("lang", ""), request.args.get("kind", ""))
        track = next((one for one in video.tracks if (one.language, one.kind) == wanted), None) if video else None
        if video is None or track is None or request.args.get("signature") != signature(key):
            return Response(
                "", 200, mimetype="text/html"
            )  # what the real service answers to an unknown or altered address
        cues = self.world.youtube.cues(video, track, request.args.get("tlang"))
        return Response(
            timed_text(cues, rich=request.args.get("fmt") == "srv3"), content_type="text/xml; charset=UTF-8"
        )


def signature(key: str) -> str:
    """The invented signature in a caption track's address."""
    return f"SANDBOX.{key}"


def timed_text(cues: list[tuple[float, float, str]], *, rich: bool = False) -> str:
    """Cues as XML; text is escaped twice, as YouTube's is. `rich`: the srv3 form (milliseconds, <p>)."""
    if rich:
        lines = "".join(
            f'<p t="{round(start * 1000)}" d="{round(length * 1000)}">{html.escape(text)}</p>\n'
            for start, length, text in cues
        )
        return f'<?xml version="1.0" encoding="utf-8" ?><timedtext format="3">\n<body>\n{lines}</body>\n</timedtext>\n'
    lines = "".join(
        f'<text start="{start:g}" dur="{length:g}">{html.escape(html.escape(text), quote=False)}</text>'
        for start, length, text in cues
    )
    return f'<?xml version="1.0" encoding="utf-8" ?><transcript>{lines}</transcript>'


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
        "playabilityStatus": {"status": "OK", "playableInEmbed": True, "contextParams": "Q0FFU0FnZ0M="},
        "streamingData": _streams(video),
        "videoDetails": details,
    }
    if video.tracks:
        answer["captions"] = {"playerCaptionsTracklistRenderer": _captions(video)}
    return answer


def watch_page(video: Video | None, key: str) -> str:
    """The page of a video: settings with the key, the first player answer, the page's data."""
    config = {
        "CLIENT_CANARY_STATE": "none",
        "DEVICE": "cbr=Sandbox",
        "HL": "en",
        "INNERTUBE_API_KEY": PAGE_KEY,
        "INNERTUBE_API_VERSION": "v1",
        "INNERTUBE_CLIENT_NAME": "WEB",
        "INNERTUBE_CLIENT_VERSION": "2.20261101.00.00",
        "VISITOR_DATA": "Q2dzU2FuZGJveA%3D%3D",
        "INNERTUBE_CONTEXT": {
            "client": {"hl": "en", "gl": "US", "remoteHost": "2001:db8::7", "visitorData": "Q2dzU2FuZGJveA%3D%3D"}
        },
    }
    player = player_answer(video, key)
    for track in player.get("captions", {}).get("playerCaptionsTracklistRenderer", {}).get("captionTracks", []):
        track["name"] = {"simpleText": track["name"]["runs"][0]["text"]}  # as the page writes it
    title = html.escape(video.title if video else "YouTube").replace("\x00", "").encode("utf-8", "replace").decode()
    padding = "\n".join(
        f".ytd-part-{number}{{margin:0 auto;padding:{number % 9}px;color:#0f0f0f}}" for number in range(250)
    )
    return (
        f'<!DOCTYPE html><html lang="en"><head><title>{title} - YouTube</title><style>{padding}</style>'
        f'<script nonce="sandbox">(function() {{window.ytcfg = {{}};ytcfg.set({_script(config)}); }})();</script></head><body dir="ltr">'
        f"<script nonce=\"sandbox\">var ytInitialPlayerResponse = {_script(player)};var meta = document.createElement('meta');</script>"
        f'<script nonce="sandbox">var ytInitialData = {_script(_page_data(video, key))};</script></body></html>'
    )


def consent_page(key: str = "") -> str:
    """The cookie wall that comes in place of a watch page."""
    return (
        '<!DOCTYPE html><html lang="en"><head><title>Before you continue to YouTube</title></head><body>'
        '<form action="https://consent.youtube.com/s" method="POST"><input type="hidden" name="gl" value="DE">'
        f'<input type="hidden" name="continue" value="{SITE}/watch?v={html.escape(key)}"><input type="hidden" name="v"'
        ' value="cb.20261101-00-p0.en+FX+000">'
        "<button>I agree</button></form></body></html>"
    )


def captcha_page() -> str:
    """The page that a blocked client sees."""
    return (
        '<!DOCTYPE html><html><head><title>YouTube</title><script src="https://www.google.com/recaptcha/api.js" async defer></script></head><body>'
        '<div id="captcha-page"><form action="/das_captcha" method="POST">'
        '<div class="g-recaptcha" data-sitekey="sandbox"></div></form></div></body></html>'
    )


def bot_answer() -> dict[str, Any]:
    """The player's answer to a blocked client."""
    return {
        **_around(),
        "playabilityStatus": {"status": "LOGIN_REQUIRED", "reason": "Sign in to confirm you’re not a bot"},
    }


def _script(value: Any) -> str:
    return json.dumps(value).replace("<", "\\u003c").replace("&", "\\u0026")


def _around() -> dict[str, Any]:
    return {
        "responseContext": {
            "visitorData": "Q2dzU2FuZGJveA%3D%3D",
            "serviceTrackingParams": [
                {
                    "service": "GFEEDBACK",
                    "params": [{"key": "is_viewed_live", "value": "False"}, {"key": "logged_in", "value": "0"}],
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
                "baseUrl": f"{SITE}/api/timedtext?{urlencode(query)}&lang={track.language}&fmt=srv3",
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
            {"languageCode": code, "languageName": {"runs": [{"text": NAMES[code]}]}}
            for code in ("ar", "en", "fr", "de", "ja", "es")
        ],
        "defaultAudioTrackIndex": 0,
    }


def _name(track: Track) -> str:
    return NAMES[track.language] + (" (auto-generated)" if track.kind else "")


def _page_data(video: Video | None, key: str) -> dict[str, Any]:
    if video is None or not video.in_api or video.player == "gone":
        return {
            "responseContext": {},
            "contents": {"twoColumnWatchNextResults": {"results": {"results": {"contents": []}}}},
            "currentVideoEndpoint": {"watchEndpoint": {"videoId": key}},
        }
    owner = {"browseEndpoint": {"browseId": video.channel.id, "canonicalBaseUrl": f"/channel/{video.channel.id}"}}
    secondary: dict[str, Any] = {
        "owner": {
            "videoOwnerRenderer": {
                "title": {"runs": [{"text": video.channel.title, "navigationEndpoint": owner}]},
                "navigationEndpoint": owner,
            }
        },
        "attributedDescription": {"content": video.description},
    }
    data: dict[str, Any] = {
        "responseContext": {"mainAppWebResponseContext": {"loggedOut": True}},
        "contents": {
            "twoColumnWatchNextResults": {
                "results": {
                    "results": {
                        "contents": [
                            {"videoPrimaryInfoRenderer": {"title": {"runs": [{"text": video.title}]}}},
                            {"videoSecondaryInfoRenderer": secondary},
                        ]
                    }
                },
                "secondaryResults": {
                    "secondaryResults": {
                        "results": [{"compactVideoRenderer": _related(other)} for other in video.channel.videos[:8]]
                    }
                },
            }
        },
        "currentVideoEndpoint": {"watchEndpoint": {"videoId": video.id}},
        "engagementPanels": [],
    }
    if video.game:
        # The label has stood in two places over the years; videos of odd number have the older one.
        browse, name = GAMES[video.game]
        endpoint = {"browseEndpoint": {"browseId": browse, "canonicalBaseUrl": f"/channel/{browse}"}}
        if video.number % 2:
            secondary["metadataRowContainer"] = {
                "metadataRowContainerRenderer": {
                    "rows": [
                        {
                            "richMetadataRowRenderer": {
                                "contents": [
                                    {
                                        "richMetadataRenderer": {
                                            "style": "RICH_METADATA_RENDERER_STYLE_BOX_ART",
                                            "title": {"simpleText": name},
                                            "subtitle": {"simpleText": "2011"},
                                            "callToAction": {"simpleText": "Browse game"},
                                            "endpoint": endpoint,
                                        }
                                    }
                                ]
                            }
                        }
                    ]
                }
            }
        else:
            data["engagementPanels"].append(
                {
                    "engagementPanelSectionListRenderer": {
                        "content": {
                            "structuredDescriptionContentRenderer": {
                                "items": [
                                    {
                                        "videoDescriptionGamingSectionRenderer": {
                                            "headerText": {"simpleText": "Gaming"},
                                            "mediaLockups": [
                                                {
                                                    "mediaLockupRenderer": {
                                                        "title": {"simpleText": name},
                                                        "subtitle": {"simpleText": "2011"},
                                                        "endpoint": endpoint,
                                                    }
                                                }
                                            ],
                                        }
                                    }
                                ]
                            }
                        }
                    }
                }
            )
    return data


def _related(video: Video) -> dict[str, Any]:
    owner = {"browseEndpoint": {"browseId": video.channel.id}}
    return {
        "videoId": video.id,
        "title": {"simpleText": video.title},
        "lengthText": {"simpleText": f"{video.seconds // 60}:{video.seconds % 60:02d}"},
        "longBylineText": {"runs": [{"text": video.channel.title, "navigationEndpoint": owner}]},
    }
