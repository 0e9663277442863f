"""Answers of the Data API have the form of recorded ones."""

import json
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.youtube.service import refusal
from tests.faults import Sandbox
from tests.sandbox.answers import form, lacking
from tests.sandbox.domains import of_case

PARTS = {
    "playlistItems": "snippet",
    "videos": "snippet,contentDetails,status,statistics",
}


GONE = {
    "dislikeCount",
    "defaultLanguage",
    "trackingAnalyticsAccountId",
    "unsubscribedTrailer",
    "image",
    "standard",
    "maxres",
    "country",
    "nextPageToken",
    "prevPageToken",
}


@pytest.mark.parametrize(
    ("file", "method", "query"),
    [
        (
            "search/search_channels.json",
            "search",
            {"q": "Minecraft", "type": "channel", "part": "snippet", "maxResults": 3},
        ),
        (
            "playlist_items/playlist_items_paged_1.json",
            "playlistItems",
            {"part": PARTS["playlistItems"]},
        ),
        ("videos/video_api_response.json", "videos", {"part": PARTS["videos"]}),
        ("videos/videos_info_multi.json", "videos", {"part": "snippet,player"}),
    ],
)
def test_answers_have_the_recorded_form(
    recorded: Path, services: Sandbox, data_api: Any, file: str, method: str, query: dict[str, Any]
) -> None:
    channel = services.world.youtube.channels[0]
    more = {
        "playlistItems": {"playlistId": channel.uploads},
    }
    one = of_case(services.world.youtube, "manual")[0]
    query |= more.get(method, {"id": one.id} if method == "videos" else {})
    made = getattr(data_api, method)().list(**query).execute()
    made["items"] = [item for item in made["items"] if item["snippet"]["title"] != "Private video"]
    real = json.loads((recorded / "youtube" / file).read_text(encoding="utf-8"))
    assert [
        line
        for line in lacking(form(real), form(made))
        if not any(f".{name}" in line for name in GONE)
    ] == []


@pytest.mark.parametrize(
    ("file", "make"),
    [
        ("errors/error_response_400_key_invalid.json", "key_invalid"),
        ("errors/error_permission_403.json", "key_missing"),
    ],
)
def test_errors_have_the_recorded_form(recorded: Path, file: str, make: str) -> None:
    code, made = refusal(make)
    real = json.loads((recorded / "youtube" / file).read_text(encoding="utf-8"))
    assert code == real["error"]["code"]
    assert lacking(form(real), form(made)) == []
