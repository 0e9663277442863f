"""The watch page of the sandbox's YouTube, as written down in data/youtube/watch_page.json."""

from __future__ import annotations

import html
import json
from functools import partial
from typing import Any

from kb.sandbox.json_templates import written
from kb.sandbox.youtube.catalogue import Video
from kb.sandbox.youtube.player import is_gone, player_answer

PAGE_KEY = "sandbox_page_key"  # every page shows it; the player wants it back
_part = partial(written, "youtube/watch_page.json")


def watch_page(video: Video | None, key: str) -> str:
    """The page of a video: settings with the key, the first player answer, the page's data."""
    config = _part("settings", {"key": PAGE_KEY})
    player = player_answer(video, key)
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
