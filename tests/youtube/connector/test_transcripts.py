"""Captions that can be had only with a PO token: one try a day, an outcome of its own."""

import json
from dataclasses import replace
from typing import Any

import pytest

from kb.sandbox.youtube.cases import Track
from tests.sandbox.domains import of_case
from tests.youtube.connector.test_fetch import CRAWL, finish
from tests.youtube.job import Job

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
    assert "for want of a PO token" in job.kb("status").stdout

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
    from kb.sandbox.youtube import web

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
    """More of them than failures in a row stop a run, first in the queue."""
    job.profile(("min_views = 100\n", "min_views = 100\nmax_tries = 1\n"))
    good = [one for one in job.sandbox.world.youtube.videos.values() if one.case.stage is None]
    bad = [video.id for video in good if video.tracks == [Track("en")]][:7]
    job.sandbox.faults.add(f"/timedtext.*v=({'|'.join(bad)})", times=None, **EMPTY)
    for _ in range(2):
        summary = job.done(*CRAWL)
        assert (summary["failed"], summary["left"]) == (len(bad), 0)
    job.sandbox.faults.clear()
    finish(job)
    assert json.loads(job.kb("status", "--json").stdout)["sources"]["youtube"]["po_token"] == 0
