"""What is kept of a watch page and a player answer: the largest stream, the game's label,
playability, tracks.

Both are full of signed addresses, the visitor's data and public keys; nothing but these facts
leaves this file.
"""

import json
import re
from collections.abc import Iterator
from typing import Any

from kb.schema.coerce import inner

_DATA = re.compile(r"(?:var\s+ytInitialData|window\[\"ytInitialData\"\])\s*=\s*")
# Where watch pages show the game of a video, newest first.
_LABELS = ("videoDescriptionGamingSectionRenderer", "richMetadataRenderer")
# Parts of the page that are about other videos and channels.
_OTHERS = {"secondaryResults", "owner", "videoOwnerRenderer", "compactVideoRenderer"}


def facts(answer: Any, page: str, game_ids: tuple[str, ...] = ()) -> dict[str, Any]:
    """The `player` object of a transcripts envelope (schemas/raw/youtube/transcripts.json).

    `answer` is the player's JSON, `page` the watch page's HTML ("" when it was not read),
    `game_ids` the browse ids that the profile knows, which are looked for outside of the usual
    places as well.
    """
    answer = answer if isinstance(answer, dict) else {}
    width, height, fps = largest_stream(answer.get("streamingData"))
    length = inner(answer, "videoDetails", "lengthSeconds")
    playability = answer.get("playabilityStatus")
    tracks = inner(answer, "captions", "playerCaptionsTracklistRenderer", "captionTracks")
    label_id, label = game(page, game_ids)
    return {
        "width": width,
        "height": height,
        "fps": fps,
        "length_s": int(length) if isinstance(length, str) and length.isdecimal() else None,
        "game_label_id": label_id,
        "game_label": label,
        "playability": _text(inner(playability, "status")),
        "reason": _text(inner(playability, "reason")),
        "tracks": [
            {
                "language": track["languageCode"],
                "kind": "asr" if track.get("kind") == "asr" else "manual",
            }
            for track in (tracks if isinstance(tracks, list) else ())
            if isinstance(track, dict) and isinstance(track.get("languageCode"), str)
        ],
    }


def game(page: str, game_ids: tuple[str, ...] = ()) -> tuple[str | None, str | None]:
    """(browse id, title) of the game that a watch page names; (None, None) when it names none or
    can't be read.
    """
    data = page_data(page)
    if data is None:
        return None, None
    for name in _LABELS:
        for node in _named(data, name):
            for browse_id in _browse_ids(node):
                return browse_id, _title(node)
    for browse_id in _browse_ids(data):
        if browse_id in game_ids:
            return browse_id, None
    return None, None


def page_data(page: str) -> Any:
    """The page's own data (ytInitialData); None when there is none."""
    match = _DATA.search(page)
    if not match:
        return None
    try:
        return json.JSONDecoder().raw_decode(page, match.end())[0]
    except ValueError:
        return None


def largest_stream(streams: Any) -> tuple[int | None, int | None, int | None]:
    """Width and height in px and frames a second of the largest stream; the higher rate of two
    alike.
    """
    sizes = []
    for kind in ("adaptiveFormats", "formats"):
        listed = streams.get(kind) if isinstance(streams, dict) else None
        for stream in listed if isinstance(listed, list) else ():
            size: list[Any] = []
            if isinstance(stream, dict) and not is_storyboard(stream):
                size = [stream.get(name) for name in ("width", "height")]
            if len(size) == 2 and all(isinstance(edge, int) and edge > 0 for edge in size):
                fps = stream.get("fps")
                sizes.append(
                    (size[0] * size[1], fps if isinstance(fps, int) and fps > 0 else 0, *size)
                )
    if not sizes:
        return None, None, None
    _, fps, width, height = max(sizes)
    return width, height, fps or None


def is_storyboard(stream: dict[str, Any]) -> bool:
    """Whether what yt-dlp lists as a format is sheets of small pictures, or has no picture."""
    return stream.get("vcodec") == "none" or "mhtml" in (stream.get("ext"), stream.get("protocol"))


def _named(node: Any, name: str) -> Iterator[Any]:
    """Every value under that key, outside of what is about other videos."""
    if isinstance(node, dict):
        for key, inner in node.items():
            if key == name:
                yield inner
            elif key not in _OTHERS:
                yield from _named(inner, name)
    elif isinstance(node, list):
        for inner in node:
            yield from _named(inner, name)


def _browse_ids(node: Any) -> Iterator[str]:
    yield from (
        value
        for value in _named(node, "browseId")
        if isinstance(value, str) and value.startswith("UC")
    )


def _title(node: Any) -> str | None:
    for title in _named(node, "title"):
        text = inner(title, "simpleText") or "".join(
            run.get("text", "") for run in (inner(title, "runs") or []) if isinstance(run, dict)
        )
        if text:
            return str(text)
    return None


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None
