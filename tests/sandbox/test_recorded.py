"""The sandbox's answers have the form of recorded ones, read by the services' real clients."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import youtube_transcript_api
from defusedxml import ElementTree
from googleapiclient.discovery import build
from requests import Session
from requests.adapters import HTTPAdapter
from youtube_transcript_api import YouTubeTranscriptApi

from kb.sandbox.wiki.generated import RecordedWiki
from kb.sandbox.world import World
from kb.sandbox.youtube import web
from kb.sandbox.youtube.captions import SpokenCue
from kb.sandbox.youtube.service import refusal
from tests.faults import Sandbox
from tests.sandbox.domains import of_case
from tests.youtube import walls

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


@pytest.fixture(scope="module")
def services() -> Iterator[Sandbox]:
    """YouTube alone, with every case once."""
    with Sandbox(World(n_channels=9, n_videos=80), services=["youtube"]) as sandbox:
        yield sandbox


def form(value: Any) -> Any:
    """Keys and types of a JSON value; of a list its first element's."""
    if isinstance(value, dict):
        return {name: form(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [form(value[0])] if value else []
    return type(value).__name__


def lacking(real: Any, made: Any, path: str = "") -> list[str]:
    """Where the sandbox's answer lacks a field of the recorded one, or has it in another type."""
    if isinstance(real, dict) and isinstance(made, dict):
        return [
            found
            for name in real
            for found in (
                [f"{path}.{name} is absent"]
                if name not in made
                else lacking(real[name], made[name], f"{path}.{name}")
            )
        ]
    if isinstance(real, list) and isinstance(made, list):
        return lacking(real[0], made[0], path + "[]") if real and made else []
    return [] if type(real) is type(made) else [f"{path}: {real!r} and {made!r}"]


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
    recorded: Path, services: Sandbox, file: str, method: str, query: dict[str, Any]
) -> None:
    settings = services.settings()
    data_api = build(
        "youtube",
        "v3",
        developerKey=settings["YOUTUBE_API_KEY"],
        static_discovery=True,
        cache_discovery=False,
        client_options={"api_endpoint": settings["KB_YOUTUBE_ENDPOINT"]},
    )
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


@pytest.fixture
def client(services: Sandbox) -> YouTubeTranscriptApi:
    """The real client, for which https://www.youtube.com is the sandbox."""
    root = services.servers["youtube"].url

    class ToSandbox(HTTPAdapter):
        def send(self, request: Any, **options: Any) -> Any:
            request.url = request.url.replace("https://www.youtube.com", root)
            return super().send(request, **options)

    session = Session()
    session.mount("https://www.youtube.com/", ToSandbox())
    return YouTubeTranscriptApi(http_client=session)


def test_captions_come_as_the_world_says_them(
    services: Sandbox, client: YouTubeTranscriptApi
) -> None:
    world = services.world.youtube
    video = of_case(world, "manual before automatic")[0]
    tracks = {track.is_generated: track for track in client.list(video.id)}
    for generated, track in tracks.items():
        said = world.cues(
            video, next(one for one in video.tracks if (one.kind == "asr") == generated)
        )
        assert [(cue.start, cue.duration, cue.text) for cue in track.fetch()] == [
            cue[:3] for cue in said
        ]


@pytest.mark.parametrize(
    ("case", "error"),
    [
        ("no captions", youtube_transcript_api.TranscriptsDisabled),
        ("gone between reading and watching", youtube_transcript_api.VideoUnavailable),
        ("gone between listing and reading", youtube_transcript_api.VideoUnavailable),
        ("age restricted", youtube_transcript_api.AgeRestricted),
    ],
)
def test_what_can_not_be_had(
    services: Sandbox, client: YouTubeTranscriptApi, case: str, error: type[Exception]
) -> None:
    with pytest.raises(error):
        client.list(of_case(services.world.youtube, case)[0].id)


def test_the_walls_have_the_marks_of_the_recorded_ones(recorded: Path) -> None:
    folder = recorded / "youtube" / "transcripts"
    for file, made, mark in (
        (
            "youtube_consent_page.html",
            walls.consent_page(),
            'action="https://consent.youtube.com/s"',
        ),
        ("youtube_consent_page.html", walls.consent_page(), 'name="v" value="'),
        ("youtube_too_many_requests.html", walls.captcha_page(), 'class="g-recaptcha"'),
    ):
        assert mark in (folder / file).read_text(encoding="utf-8")
        assert mark in made
        assert "INNERTUBE_API_KEY" not in made


def test_timed_text_has_the_recorded_form(recorded: Path) -> None:
    real = ElementTree.fromstring(
        (recorded / "youtube" / "transcripts" / "transcript.xml").read_text(encoding="utf-8")
    )
    made = ElementTree.fromstring(
        web.timed_text([SpokenCue(0.0, 1.5, "don't <b>"), SpokenCue(1.5, 2.0, "a & b")])
    )
    assert made.tag == real.tag
    assert {(one.tag, *one.attrib) for one in made} == {(one.tag, *one.attrib) for one in real}
    assert made[0].text == "don&#x27;t &lt;b&gt;"  # escaped twice


def test_the_player_answer_has_the_recorded_form(recorded: Path, services: Sandbox) -> None:
    folder = recorded / "youtube" / "transcripts"
    world = services.world.youtube
    for file, case, parts in (
        (
            "youtube.innertube.json",
            "manual",
            {
                "streamingData": ("formats", "adaptiveFormats"),
                "videoDetails": None,
                "captions": None,
            },
        ),
        ("youtube_age_restricted.innertube.json", "age restricted", {"videoDetails": None}),
        (
            "youtube_transcripts_disabled2.innertube.json",
            "no captions",
            {"streamingData": ("formats",)},
        ),
    ):
        real = json.loads((folder / file).read_text(encoding="utf-8"))
        video = of_case(world, case)[0]
        made = web.player_answer(video)
        assert made["playabilityStatus"]["status"] == real["playabilityStatus"]["status"]
        assert made["playabilityStatus"].get("reason") == real["playabilityStatus"].get("reason")
        assert ("captions" in made) == ("captions" in real)
        for part, inner in parts.items():
            ours, theirs = made[part], real[part]
            wanted = {name: theirs[name] for name in inner} if inner else theirs
            missing = [
                line
                for line in lacking(form(wanted), form(ours), part)
                if not re.search(
                    r"url|Range|lastModified|contentLength|colorInfo|averageBitrate|audio"
                    r"|qualityOrdinal|thumbnail|defaultCaption|captionsInitial"
                    r"|defaultTranslation|latency|LowLatency",
                    line,
                )
            ]
            assert missing == []


@pytest.mark.parametrize(
    "path",
    [
        "/api/pages.json",
        "/images/none.png",
        "/images/../api/pages.json",
        "/static/../api/pages.json",
        "/robots.txt/../api/pages.json",
    ],
)
def test_only_pictures_styles_and_scripts_are_served(path: str) -> None:
    assert RecordedWiki().file(path) is None
