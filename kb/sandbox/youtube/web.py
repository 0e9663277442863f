"""Serves the web site of the sandbox's YouTube: watch page, player answer and timed text.

In the form that youtube-transcript-api reads: the page gives a key, the player answer (asked with
that key) playability, streams and caption tracks, a track's address the text. Lighter than the real
ones (160 KB compressed), same places.
"""

import html
import json
from collections.abc import Sequence
from functools import partial
from typing import Any
from urllib.parse import urlencode

from werkzeug.wrappers import Request, Response

from kb.sandbox.json_templates import written
from kb.sandbox.world import World
from kb.sandbox.youtube.captions import SpokenCue
from kb.sandbox.youtube.cases import Track, Video

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


_player_part = partial(written, "youtube/player.json")


def is_gone(video: Video) -> bool:
    """Whether nobody is shown the video any more."""
    return not video.in_api or video.player == "gone"


def player_answer(video: Video | None) -> dict[str, Any]:
    """The player's answer for a video; None or a vanished one is unavailable."""
    around = _player_part("around", {})
    if video is None or is_gone(video):
        return {**around, **_player_part("gone", {})}
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
    values = {"details": _player_part("details", details)}
    if video.player == "age":
        return {**around, **_player_part("age", values)}
    captions = _captions(video) if video.tracks else None
    return {**around, **_player_part("plays", {**values, **_streams(video), "captions": captions})}


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
        _player_part("frames", {**frames(edge), "itag": itag, "edge": edge, "bitrate": edge * 2500})
        for itag, edge in reversed(LADDER)
        if edge <= short
    ]
    return {
        "whole": [_player_part("both", frames(360))],
        "adaptive": [*adaptive, _player_part("sound", values)],
    }


def _captions(video: Video) -> Any:
    languages = dict.fromkeys(("ar", "en", "fr", "de", "ja", "es", video.language))
    values = {
        "tracks": [_track(video, track) for track in video.tracks],
        "indices": list(range(len(video.tracks))),
        "languages": [
            _player_part("language", {"code": code, "name": NAMES.get(code, code)})
            for code in languages
        ],
    }
    return _player_part("captions", values)


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
    return _player_part("track", values)


class YouTubeWeb:
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
        return Response(watch_page(self.world.youtube.video_of(key), key), mimetype="text/html")

    def _player(self, request: Request) -> Response:
        body = request.get_json(silent=True) or {}
        key = body.get("videoId", "")
        request.environ["sandbox.about"] = key
        if request.args.get("key") != PAGE_KEY:
            return _refusal("API key not valid. Please pass a valid API key.")
        if "client" not in body.get("context", {}):
            return _refusal("Request contains an invalid argument.")
        return Response(
            json.dumps(player_answer(self.world.youtube.video_of(key))),
            mimetype="application/json",
        )

    def _timed_text(self, request: Request) -> Response:
        key = request.args.get("v", "")
        request.environ["sandbox.about"] = key
        video = self.world.youtube.video_of(key)
        wanted = (request.args.get("lang", ""), request.args.get("kind", ""))
        track = (
            next((track for track in video.tracks if (track.language, track.kind) == wanted), None)
            if video
            else None
        )
        locked = track is not None and track.po_token and "pot" not in request.args
        altered = request.args.get("signature") != signature(key)
        if video is None or track is None or locked or altered:
            return Response(
                "", 200, mimetype="text/html"
            )  # what the real service answers to an unknown or altered address, or without a token
        cues = self.world.youtube.cues(video, track, request.args.get("tlang"))
        form = srv3 if request.args.get("fmt") == "srv3" else timed_text
        return Response(form(cues), content_type="text/xml; charset=UTF-8")


def _refusal(message: str) -> Response:
    error = {"code": 400, "message": message, "status": "INVALID_ARGUMENT"}
    return Response(json.dumps({"error": error}), 400, mimetype="application/json")


def timed_text(cues: Sequence[SpokenCue]) -> str:
    """Cues as XML in the plain form; text is escaped twice, as YouTube's is."""
    lines = "".join(
        f'<text start="{cue.start:.10g}" dur="{cue.duration:.10g}">'
        f"{html.escape(html.escape(cue.text), quote=False)}</text>"
        for cue in cues
    )
    return f'<?xml version="1.0" encoding="utf-8" ?><transcript>{lines}</transcript>'


def srv3(cues: Sequence[SpokenCue]) -> str:
    """Cues as XML in the form with the times of words (ms), and with the empty lines of the
    rolling display between automatic ones.
    """
    lines = []
    for number, cue in enumerate(cues):
        start, length = round(cue.start * 1000), round(cue.duration * 1000)
        if number and cue.word_starts:
            lines.append(f'<p t="{start - 10}" d="{length}" w="1" a="1">\n</p>')
        words = cue.text.split() if len(cue.word_starts) > 1 else ()
        spoken = ""
        for place, (word, at) in enumerate(zip(words, cue.word_starts, strict=False)):
            offset = round(at * 1000) - start  # of the word in its line (ms); none for the first
            later = f' t="{offset}"' if offset else ""
            spoken += f'<s{later} ac="0">{" " if place else ""}{html.escape(word)}</s>'
        window = ' w="1"' if cue.word_starts else ""
        text = spoken or html.escape(cue.text, quote=False)
        lines.append(f'<p t="{start}" d="{length}"{window}>{text}</p>')
    body = "\n".join(lines)
    return (
        '<?xml version="1.0" encoding="utf-8" ?><timedtext format="3">\n<body>\n'
        f"{body}\n</body></timedtext>\n"
    )


PAGE_KEY = "sandbox_page_key"  # every page shows it; the player wants it back
_part = partial(written, "youtube/watch_page.json")


def watch_page(video: Video | None, key: str) -> str:
    """The page of a video: settings with the key, the first player answer, the page's data."""
    config = _part("settings", {"key": PAGE_KEY})
    player = player_answer(video)
    for track in (
        player.get("captions", {})
        .get("playerCaptionsTracklistRenderer", {})
        .get("captionTracks", [])
    ):
        track["name"] = {"simpleText": track["name"]["runs"][0]["text"]}  # as the page writes it
    title = (
        html.escape(video.title if video else "YouTube")
        .replace("\x00", "")
        .encode("utf-8", "replace")
        .decode()
    )
    padding = "\n".join(
        f".ytd-part-{number}{{margin:0 auto;padding:{number % 9}px;color:#0f0f0f}}"
        for number in range(250)
    )
    return (
        f'<!DOCTYPE html><html lang="en"><head><title>{title} -'
        f" YouTube</title><style>{padding}</style>"
        f'<script nonce="sandbox">(function() {{window.ytcfg = {{}};ytcfg.set({_script(config)});'
        f' }})();</script></head><body dir="ltr">'
        f'<script nonce="sandbox">var ytInitialPlayerResponse = {_script(player)};var meta ='
        " document.createElement('meta');</script>"
        '<script nonce="sandbox">var ytInitialData ='
        f" {_script(_page_data(video, key))};</script></body></html>"
    )


def _script(value: Any) -> str:
    return json.dumps(value).replace("<", "\\u003c").replace("&", "\\u0026")


def _page_data(video: Video | None, key: str) -> Any:
    if video is None or is_gone(video):
        return _part("gone", {"id": key})
    row, panels = None, []
    if video.label:
        # The label has stood in two places over the years; videos of odd number have the older one.
        browse, name = video.label
        values = {"name": name, "endpoint": _part("channel", {"id": browse})}
        if video.number % 2:
            row = _part("label_row", values)
        else:
            panels = [_part("label_panel", values)]
    values = {
        **_of(video),
        "description": video.description,
        "owner": _part("channel", {"id": video.channel.id}),
        "row": row,
        "panels": panels,
        "related": [_part("related", _of(other)) for other in video.channel.videos[:8]],
    }
    return _part("there", values)


def _of(video: Video) -> dict[str, Any]:
    return {
        "id": video.id,
        "title": video.title,
        "length": f"{video.seconds // 60}:{video.seconds % 60:02d}",
        "channel_id": video.channel.id,
        "channel_title": video.channel.title,
    }
