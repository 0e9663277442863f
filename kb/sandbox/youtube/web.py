"""The web side of the sandbox's YouTube: watch page, player answer and timed text.

In the form that youtube-transcript-api reads: the page gives a key, the player answer (asked with
that key) the caption tracks, a track's address the text. Lighter than the real ones (160 KB
compressed), same places.
"""

from __future__ import annotations

import html
import json

from werkzeug.wrappers import Request, Response

from kb.sandbox.speech import MUSIC, ROLLING, word_starts
from kb.sandbox.world import World
from kb.sandbox.youtube.player import player_answer, signature
from kb.sandbox.youtube.watch_page import PAGE_KEY, watch_page


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
        return Response(watch_page(self.world.youtube.videos.get(key), key), mimetype="text/html")

    def _player(self, request: Request) -> Response:
        body = request.get_json(silent=True) or {}
        key = body.get("videoId", "")
        request.environ["sandbox.about"] = key
        if request.args.get("key") != PAGE_KEY:
            return _refusal("API key not valid. Please pass a valid API key.")
        if "client" not in body.get("context", {}):
            return _refusal("Request contains an invalid argument.")
        return Response(
            json.dumps(player_answer(self.world.youtube.videos.get(key), key)),
            mimetype="application/json",
        )

    def _timed_text(self, request: Request) -> Response:
        key = request.args.get("v", "")
        request.environ["sandbox.about"] = key
        video = self.world.youtube.videos.get(key)
        wanted = (request.args.get("lang", ""), request.args.get("kind", ""))
        track = (
            next((one for one in video.tracks if (one.language, one.kind) == wanted), None)
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
        return Response(
            word_timed(cues, automatic=track.kind == "asr")
            if request.args.get("fmt") == "srv3"
            else timed_text(cues),
            content_type="text/xml; charset=UTF-8",
        )


def _refusal(message: str) -> Response:
    error = {"code": 400, "message": message, "status": "INVALID_ARGUMENT"}
    return Response(json.dumps({"error": error}), 400, mimetype="application/json")


def timed_text(cues: list[tuple[float, float, str]]) -> str:
    """Cues as XML in the plain form; text is escaped twice, as YouTube's is."""
    lines = "".join(
        (
            f'<text start="{start:g}"'
            f' dur="{length:g}">{html.escape(html.escape(text), quote=False)}</text>'
        )
        for start, length, text in cues
    )
    return f'<?xml version="1.0" encoding="utf-8" ?><transcript>{lines}</transcript>'


def word_timed(cues: list[tuple[float, float, str]], *, automatic: bool) -> str:
    """Cues as XML in the form `srv3`: times in ms, and of an automatic track each word's own."""
    lines = []
    for start, length, text in cues:
        inner = html.escape(text)
        if automatic and text != MUSIC:
            words = text.split()
            at = [round(second * 1000) for second in word_starts(words, length / ROLLING)]
            first, *rest = (html.escape(word) for word in words)
            inner = f'<s ac="0">{first}</s>' + "".join(
                f'<s t="{ms}" ac="0"> {word}</s>' for ms, word in zip(at[1:], rest, strict=True)
            )
        mark = ' w="1"' if automatic else ""
        start_ms, shown_ms = round(start * 1000), round(length * 1000)
        lines.append(f'<p t="{start_ms}" d="{shown_ms}"{mark}>{inner}</p>\n')
    return (
        '<?xml version="1.0" encoding="utf-8" ?><timedtext'
        f' format="3">\n<body>\n{"".join(lines)}</body>\n</timedtext>\n'
    )
