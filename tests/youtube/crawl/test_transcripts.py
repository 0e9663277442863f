"""Transcripts of the web site, with the facts of the player."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.youtube import web
from kb.sandbox.youtube.cases import Track
from kb.schema import raw
from kb.youtube.crawl.player import facts
from tests.sandbox.domains import of_case
from tests.youtube.crawl.test_fetch import CRAWL, finish
from tests.youtube.job import Job
from tests.youtube.parse.test_recorded import load

TOMORROW = "2026-11-21T00:30:00Z"  # the day of UTC counts
EMPTY = {"status": 200, "body": ""}


def lock(job: Job, n: int = 3) -> list[str]:
    """Let the tracks of so many videos ask for a token; their ids."""
    videos = of_case(job.sandbox.world.youtube, "manual")[:n]
    for video in videos:
        video.tracks = [replace(track, po_token=True) for track in video.tracks]
    return [video.id for video in videos]


def unlock(job: Job) -> None:
    for video in job.sandbox.world.youtube.videos.values():
        video.tracks = [replace(track, po_token=False) for track in video.tracks]


@pytest.fixture
def locked(job: Job) -> Any:
    """Videos whose captions ask for a token."""
    yield lock(job)
    unlock(job)


def test_it_is_tried_once_a_day_and_counted_by_itself(job: Job, locked: list[str]) -> None:
    summary = job.done(*CRAWL)
    assert (summary["po_token"], summary["failed"], summary["left"]) == (len(locked), 0, 0)
    asked = [seen for seen in job.sandbox.ledger.requests("/watch") if seen.about in locked]
    assert len(asked) == len(locked)  # one try each
    assert not [s for s in job.sandbox.ledger.requests("/timedtext") if s.about in locked]
    outcomes = {
        one["response"]["video_id"]: one["response"]["outcome"] for one in job.raw("transcripts")
    }
    assert {outcomes[key] for key in locked} == {"po_token"}

    before = len(job.sandbox.ledger)
    assert job.done(*CRAWL)["po_token"] == len(locked)
    assert len(job.sandbox.ledger) == before  # not again on the same day
    assert job.done("status")["sources"]["youtube"]["po_token"] == len(locked)
    assert "as they need a PO token" in job.kb("status").stdout

    assert job.done("youtube", "filter")["pending"] == len(locked)
    rows = job.rows("SELECT key, reason FROM clean.youtube_pending")
    assert {row["key"]: row["reason"] for row in rows} == dict.fromkeys(locked, "po_token")

    assert job.done(*CRAWL, KB_NOW=TOMORROW)["po_token"] == len(locked)
    assert len(job.sandbox.ledger) == before + 2 * len(locked)
    unlock(job)
    job.env["KB_NOW"] = "2026-11-22T12:00:00Z"
    finish(job)


def test_where_transcripts_are_optional_the_video_is_kept(job: Job, locked: list[str]) -> None:
    job.profile(('transcripts = "required"', 'transcripts = "optional"'))
    job.done(*CRAWL)
    job.done("youtube", "filter")
    kinds = job.rows(
        "SELECT DISTINCT transcript_kind FROM clean.youtube_videos"
        f" WHERE video_id IN {tuple(locked)}"
    )
    assert kinds == [{"transcript_kind": "unknown"}]


def test_an_empty_body_of_such_a_track_says_the_same(
    job: Job, locked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library asks for a track whose address has the mark in another place."""
    written = web._player_part

    def moved(name: str, values: Any) -> Any:
        if name == "track" and "exp=xpe" in values["address"]:
            values["address"] = values["address"].replace("&exp=xpe", "")
            values["address"] = values["address"].replace("?", "?exp=xpe&", 1)
        return written(name, values)

    monkeypatch.setattr(web, "_player_part", moved)
    summary = job.done(*CRAWL)
    assert (summary["po_token"], summary["failed"]) == (len(locked), 0)
    asked = [s for s in job.sandbox.ledger.requests("/timedtext") if s.about in locked]
    assert len(asked) == len(locked)


def test_empty_captions_of_many_videos_keep_no_other_from_being_read(job: Job) -> None:
    """More of them than failures in a row stop a run, first in the queue. Each is tried twice."""
    good = [one for one in job.sandbox.world.youtube.videos.values() if one.case.stage is None]
    bad = [video.id for video in good if video.tracks == [Track("en")]][:7]
    bad += [of_case(job.sandbox.world.youtube, "asr")[0].id]
    job.sandbox.faults.add(f"/timedtext.*v=({'|'.join(bad)})", times=None, **EMPTY)
    for run in (1, 2):
        summary = job.done(*CRAWL)
        assert (summary["failed"], summary["left"]) == (len(bad), 0)
        asked = [one for one in job.sandbox.ledger.requests("/timedtext") if not one.about]
        assert len(asked) == 2 * run * (len(bad) + 1)  # an automatic track has two forms
    job.sandbox.faults.clear()
    finish(job)
    assert json.loads(job.kb("status", "--json").stdout)["sources"]["youtube"]["po_token"] == 0


def automatic(job: Job) -> str:
    """The id of a video with an automatic track only."""
    return of_case(job.sandbox.world.youtube, "asr")[0].id


def fetch(job: Job, video_id: str) -> tuple[dict[str, Any], int]:
    """The raw cues, in columns, of a video's transcript, and the requests that it took."""
    ids = job.place / "ids.txt"
    ids.write_text(video_id)
    job.done(*CRAWL, "--ids", str(ids))
    (answer,) = (one["response"] for one in job.raw("transcripts"))
    assert (answer["outcome"], answer["kind"]) == ("ok", "asr")
    return answer["cues"], len(job.sandbox.ledger.requests("/watch|/player|/timedtext"))


def test_automatic_captions_are_read_with_word_times_at_no_further_request(job: Job) -> None:
    world = job.sandbox.world.youtube
    video = world.videos[automatic(job)]
    cues, requests = fetch(job, video.id)
    assert requests == 3
    assert list(zip(*cues.values(), strict=True)) == [
        (*cue[:3], list(cue.word_starts)) for cue in world.cues(video, video.tracks[0])
    ]


@pytest.mark.parametrize(
    ("fault", "requests"),
    [
        ({"status": 404, "body": "<html>no such form</html>"}, 4),
        ({"status": 200, "body": '<timedtext format="3"><body><p t="1'}, 4),
        ({"status": 200, "body": ""}, 4),
        (None, 3),  # YouTube answers in the plain form
    ],
)
def test_without_that_form_the_plain_one_is_read(
    job: Job, fault: dict[str, Any] | None, requests: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = job.sandbox.world.youtube
    video = world.videos[automatic(job)]
    if fault is None:
        monkeypatch.setattr(web, "srv3", web.timed_text)
    else:
        job.sandbox.faults.add("/timedtext.*fmt=srv3", times=None, **fault)
    cues, asked = fetch(job, video.id)
    assert cues.pop("word_start_s") is None
    assert list(zip(*cues.values(), strict=True)) == [
        cue[:3] for cue in world.cues(video, video.tracks[0])
    ]
    assert asked == requests
    job.done("youtube", "filter")
    rows = job.rows("SELECT word_times, cues FROM clean.youtube_transcripts")
    assert [row["word_times"] for row in rows] == ["absent"]
    assert all(cue["word_start_s"] is None for cue in rows[0]["cues"])


@pytest.mark.parametrize(
    "name",
    [
        "youtube.innertube.json",
        "youtube_age_restricted.innertube.json",
        "youtube_video_unavailable.innertube.json",
        "youtube_transcripts_disabled2.innertube.json",
    ],
)
def test_a_player_s_answer_leaves_no_address_and_nothing_undeclared(
    name: str, recorded: Path
) -> None:
    answer = load(recorded / "youtube" / "transcripts" / name)
    kept = facts(answer, "")
    private = r"https?:|//|visitor|2001:db8|INNERTUBE|signature|trackingParams|expire"
    assert not re.search(private, json.dumps(kept), re.IGNORECASE)
    assert not raw.unknown_keys("youtube/transcripts", {"player": kept})
    assert kept["playability"] == answer["playabilityStatus"]["status"]
    if name == "youtube.innertube.json":
        assert (kept["width"], kept["height"], kept["fps"]) == (3840, 2160, 24)
        assert [track["kind"] for track in kept["tracks"]].count("asr") == 1
        assert len(kept["tracks"]) == 9
