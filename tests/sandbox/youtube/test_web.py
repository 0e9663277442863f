"""The sandbox's web side through the real youtube-transcript-api,
and its answers beside the recorded ones.
"""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import requests
import youtube_transcript_api as api
from youtube_transcript_api import YouTubeTranscriptApi

from kb.sandbox.youtube import web
from kb.sandbox.youtube.captions import SpokenCue
from tests.faults import Sandbox
from tests.sandbox.answers import form, lacking
from tests.sandbox.domains import of_case
from tests.youtube import walls


@pytest.fixture
def client(web: requests.Session) -> YouTubeTranscriptApi:
    return YouTubeTranscriptApi(http_client=web)


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
    assert [seen.path for seen in services.ledger.requests()[:2]] == [
        "/watch",
        "/youtubei/v1/player",
    ]


def test_languages_and_translation(services: Sandbox, client: YouTubeTranscriptApi) -> None:
    world = services.world.youtube
    assert [
        track.language_code for track in client.list(of_case(world, "British English")[0].id)
    ] == ["en-GB"]
    german = of_case(world, "translated from German")[0]
    original = client.list(german.id).find_transcript(["de"])
    translated = original.translate("en").fetch()
    assert translated.is_generated
    assert [cue.text for cue in translated] == [
        text for _, _, text, _ in world.cues(german, german.tracks[0], "en")
    ]
    stubborn = of_case(world, "German that can't be translated")[0]
    with pytest.raises(api.NotTranslatable):
        client.list(stubborn.id).find_transcript(["de"]).translate("en")


@pytest.mark.parametrize(
    ("case", "error"),
    [
        ("no captions", api.TranscriptsDisabled),
        ("gone between reading and watching", api.VideoUnavailable),
        ("gone between listing and reading", api.VideoUnavailable),
        ("age restricted", api.AgeRestricted),
    ],
)
def test_what_can_not_be_had(
    services: Sandbox, client: YouTubeTranscriptApi, case: str, error: type[Exception]
) -> None:
    with pytest.raises(error):
        client.list(of_case(services.world.youtube, case)[0].id)


def test_blocks_are_seen_as_blocks(services: Sandbox, client: YouTubeTranscriptApi) -> None:
    video = of_case(services.world.youtube, "manual")[0].id
    services.faults.add("/watch", status=200, body=walls.captcha_page())
    with pytest.raises(api.IpBlocked):
        client.list(video)
    services.faults.add("/watch", status=429)
    with pytest.raises(api.IpBlocked):
        client.list(video)
    services.faults.add("/player", status=200, body=walls.bot_answer())
    with pytest.raises(api.RequestBlocked):
        client.list(video)
    services.faults.add("/watch", status=200, body=walls.consent_page(), times=None)
    with pytest.raises(api.FailedToCreateConsentCookie):
        client.list(video)


def test_a_consent_wall_opens_to_its_cookie(
    services: Sandbox, client: YouTubeTranscriptApi
) -> None:
    services.faults.add(
        "/watch",
        status=200,
        body=walls.consent_page(),
        times=None,
        when=lambda environ: "CONSENT=" not in environ.get("HTTP_COOKIE", ""),
    )
    assert list(client.list(of_case(services.world.youtube, "manual")[0].id))
    assert len(services.ledger.requests("/watch")) == 2


def test_an_altered_address_gets_an_empty_body(services: Sandbox, web: requests.Session) -> None:
    video = of_case(services.world.youtube, "manual")[0]
    answer = web.get(f"https://www.youtube.com/api/timedtext?v={video.id}&lang=en&signature=mine")
    assert (answer.status_code, answer.content) == (200, b"")


def page_data(page: str, name: str) -> Any:
    found = re.search(rf"var {name} = ", page)
    assert found
    return json.JSONDecoder().raw_decode(page, found.end())[0]


def test_the_game_stands_in_the_pages_data(services: Sandbox, web: requests.Session) -> None:
    for name, game in (
        ("manual", "topic"),
        ("another game", "other"),
        ("no label, topic in the title", None),
    ):
        for video in of_case(services.world.youtube, name):
            page = web.get(f"https://www.youtube.com/watch?v={video.id}").text
            text = json.dumps(page_data(page, "ytInitialData"))
            assert {
                key for key, (browse, _) in services.world.domain.labels.items() if browse in text
            } == ({game} if game else set())


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
    from defusedxml import ElementTree

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
        made = web.player_answer(video, video.id)
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
