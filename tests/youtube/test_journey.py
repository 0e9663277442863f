"""Crawl, filter and export of the whole world: each video gets the verdict that it deserves, at the
price that was promised.
"""

import itertools
import re
from collections import Counter
from typing import Any

from kb.sandbox.youtube.cases import CASES
from kb.sandbox.youtube.service import KEY
from tests.sandbox.domains import of_case
from tests.youtube.job import Job, plain_units

VERDICTS = """
    SELECT video_id AS key, 'kept' AS stage, NULL AS reason, NULL AS value, NULL AS threshold
    FROM clean.youtube_videos
    UNION ALL SELECT key, stage, reason, value, threshold FROM clean.youtube_rejected
"""


def verdicts(job: Job) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in job.rows(VERDICTS)}


def test_every_video_gets_the_verdict_of_its_case(whole: Job) -> None:
    found = verdicts(whole)
    wrong = []
    for video in whole.sandbox.world.youtube.videos.values():
        row, wanted = (
            found.get(video.id, {"stage": "nothing", "reason": None}),
            video.case.stage or "kept",
        )
        if row["stage"] != wanted or (
            video.case.reason and video.case.reason not in ("none", row["reason"])
        ):
            wrong.append(
                f"{video.case.name}: {row['stage']} ({row['reason']}, {row.get('value')})"
                f" instead of {wanted} ({video.case.reason})"
            )
    assert Counter(wrong) == {}
    assert len(found) == len(whole.sandbox.world.youtube.videos)


def test_what_is_kept_says_why_and_how(whole: Job) -> None:
    rows = {row["video_id"]: row for row in whole.released()}
    world = whole.sandbox.world.youtube
    for case in CASES:
        if case.stage is None:
            for video in of_case(world, case.name):
                row = rows[video.id]
                assert (row["topic_evidence"], row["transcript_kind"]) == (
                    case.evidence,
                    case.kind,
                ), case.name


def test_released_columns_are_the_worlds_values(whole: Job) -> None:
    rows = {row["video_id"]: row for row in whole.released()}
    for video in whole.sandbox.world.youtube.videos.values():
        if video.case.stage:
            assert video.id not in rows
            continue
        row = rows[video.id]
        assert row["link"] == f"https://www.youtube.com/watch?v={video.id}"
        assert row["title"] == re.sub("[\x00\ud800-\udfff]", "\ufffd", video.title)
        assert (row["channel_id"], row["category_id"], row["license"]) == (
            video.channel.id,
            int(video.category_id),
            video.license,
        )
        assert (row["view_count"], row["like_count"]) == (
            int(video.view_count or 0),
            None if video.like_count is None else int(video.like_count),
        )
        assert (row["duration_s"], row["width"], row["height"], row["fps"]) == (
            video.seconds,
            video.width,
            video.height,
            video.fps,
        ), video.case.name
        assert row["published_at"].strftime("%Y-%m-%dT%H:%M:%SZ") == video.published_at
        assert 0 <= row["toxicity_title"] < 0.5
        assert (row["toxicity_description"] is None) == (video.description == "")


def test_word_counts_and_cues_are_those_that_were_said(whole: Job) -> None:
    world = whole.sandbox.world.youtube
    rows = {row["video_id"]: row for row in whole.rows("SELECT * FROM clean.youtube_transcripts")}
    counts = {row["video_id"]: row["word_count"] for row in whole.released()}
    for name, track, language in (
        ("manual", 0, None),
        ("asr", 0, None),
        ("translated from German", 0, "en"),
        ("manual before automatic", 1, None),
    ):
        for video in of_case(world, name):
            said = world.cues(video, video.tracks[track], language)
            cues = rows[video.id]["cues"]
            assert [cue["text"] for cue in cues] == [text for _, _, text, _ in said]
            starts = [list(one.word_starts) or None for one in said]
            assert [cue["word_start_s"] for cue in cues] == starts
            assert rows[video.id]["word_times"] == ("complete" if any(starts) else None)
            assert counts[video.id] == sum(len(text.split()) for _, _, text, _ in said)
            assert all(
                first["start_s"] + first["duration_s"] <= second["start_s"] + 0.001
                for first, second in itertools.pairwise(cues)
            )


def test_units_are_what_was_promised_and_no_more(whole: Job) -> None:
    ledger = whole.sandbox.ledger
    assert ledger.units("general") == plain_units(whole.sandbox)
    assert ledger.units("search") == 6  # a page for each keyword and phrase of the profile
    assert whole.crawl_summary["units"] == ledger.units("general") + ledger.units("search")
    assert whole.crawl_summary["requests"] == len(ledger)


def test_no_video_is_asked_for_twice_and_only_the_promising_ones_are_watched(whole: Job) -> None:
    ledger, world = whole.sandbox.ledger, whole.sandbox.world.youtube
    ids = [key for seen in ledger.requests("/videos$") for key in seen.args["id"].split(",")]
    assert sorted(ids) == sorted(world.videos)
    watched = Counter(seen.about for seen in ledger.requests("/watch"))
    assert set(watched.values()) == {1}
    cheap = {"missing", "views", "aspect_ratio", "duration"}
    expected = {
        video.id
        for video in world.videos.values()
        if video.case.stage not in cheap and video.rating is None and video.category_id == "20"
    }
    assert set(watched) == expected


def test_counts_add_up(whole: Job) -> None:
    summary = whole.filter_summary
    assert (
        summary["crawled"]
        == summary["kept"] + summary["rejected"] + summary["failed"] + summary["pending"]
        == len(whole.sandbox.world.youtube.videos)
    )
    assert (summary["failed"], summary["pending"]) == (0, 0)
    assert summary["kept"] == sum(
        case.stage is None
        for case in (video.case for video in whole.sandbox.world.youtube.videos.values())
    )


def test_a_finished_crawl_asks_nothing(whole: Job) -> None:
    before = len(whole.sandbox.ledger)
    summary = whole.done("youtube", "crawl")
    assert (len(whole.sandbox.ledger) - before, summary["requests"], summary["units"]) == (0, 0, 0)


def test_raw_data_hold_answers_and_nothing_of_the_visitor(whole: Job) -> None:
    found = {
        kind: whole.raw(kind) for kind in ("search", "playlist_items", "videos", "transcripts")
    }
    world = whole.sandbox.world.youtube
    assert {len(envelope["response"].get("items", [])) for envelope in found["videos"]} <= set(
        range(51)
    )
    titles = {
        item["id"]: item["snippet"]["title"]
        for envelope in found["videos"]
        for item in envelope["response"]["items"]
    }
    video = of_case(world, "markup in the title")[0]
    assert titles[video.id] == video.title
    for envelope in (one for kind in found.values() for one in kind):
        assert set(envelope) == {"fetched_at", "request", "status", "response"}
        assert set(envelope["request"]) == {"endpoint", "params"}
    text = str(found["transcripts"])
    for forbidden in (
        "googlevideo",
        "visitorData",
        "signature",
        "2001:db8",
        "sandbox_page_key",
        "baseUrl",
        "http",
    ):
        assert forbidden not in text


def test_the_key_is_nowhere(whole: Job) -> None:
    for path in whole.root.rglob("*"):
        if path.is_file() and path.suffix != ".zst":
            assert KEY.encode() not in path.read_bytes(), path
    for kind in ("search", "playlist_items", "videos", "transcripts"):
        assert KEY not in str(whole.raw(kind))


def test_nothing_of_a_transcript_is_released(whole: Job) -> None:
    said = {
        cue["text"]
        for row in whole.rows("SELECT cues FROM clean.youtube_transcripts LIMIT 5")
        for cue in row["cues"]
    }
    names = [path.name for path in (whole.root / "release" / "youtube").iterdir()]
    assert not [name for name in names if "transcripts" in name]
    text = str(whole.released())
    assert not [one for one in said if len(one) > 25 and one in text]
