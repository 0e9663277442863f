"""All answers about a video become one row; its transcript another."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from kb.release.folders import in_root
from kb.store.rawlog.rawlog import Envelope, Request, Segment, encode, folder
from kb.store.tables import database
from kb.store.tables.columns import word_count
from kb.youtube.card import gaps
from kb.youtube.parse import answers as parse
from kb.youtube.parse.assemble import assemble, one_row_each, second_tracks, with_tracks
from kb.youtube.parse.view_counting import view_rule
from kb.youtube.ytdlp.tracks import TrackLanguage, without_dubs
from tests.filters.made import cues
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job


def put(root: Path, *answers: dict[str, Any]) -> None:
    """One segment of second tracks."""
    segment = Segment(folder(root, "youtube", "second_tracks"))
    for answer in answers:
        request = Request("transcript", {"video_id": answer["video_id"]})
        segment.append(encode(Envelope("2026-11-20T12:00:00Z", request, 200, answer)))
    segment.close()


def heard(key: str, text: str) -> dict[str, Any]:
    about = {"video_id": key, "outcome": "ok", "reason": None, "kind": "asr", "language": "en"}
    return {**about, "original_kind": "asr", "format": parse.FORMAT, "cues": cues([0, 1, text])}


def test_second_tracks_of_a_sample_are_read_once_each(tmp_path: Path) -> None:
    put(tmp_path, heard("a", "first"), {**heard("b", "x"), "outcome": "none", "cues": None})
    put(tmp_path, heard("a", "later"), heard("c", "not asked"), heard("d", "one"))
    found = [
        (row["video_id"], row["cues"][0]["text"])
        for rows in second_tracks(tmp_path, ["a", "b", "d"], word_count)
        for row in rows.to_pylist()
    ]
    assert sorted(key for key, _ in found) == ["a", "d"]
    assert dict(found)["d"] == "one"


TIME = pa.timestamp("us", "UTC")
MONDAY, TUESDAY, FRIDAY = (datetime(2026, 11, day, tzinfo=UTC) for day in (16, 17, 20))


def answers(*rows: dict[str, Any]) -> pa.Table:
    """Rows of answers; what a row does not name is null."""
    types = {
        "video_id": pa.string(),
        "title": pa.string(),
        "availability": pa.string(),
        "missing": pa.bool_(),
        **dict.fromkeys(("view_count", "like_count", "comment_count"), pa.int64()),
        "fetched_at": TIME,
    }
    return pa.table({n: pa.array([row.get(n) for row in rows], t) for n, t in types.items()})


def video(at: datetime, title: str | None = None, views: int | None = None, **other: Any) -> Any:
    about = {"video_id": "a", "title": title, "view_count": views, "fetched_at": at}
    return {**about, "missing": False, **other}


@pytest.mark.parametrize(
    ("api", "file", "title", "views"),
    [
        (video(MONDAY, "old", 1), video(FRIDAY, "new", 2), "new", 2),
        (video(FRIDAY, "new", 2), video(MONDAY, "old", 1), "new", 2),
        (video(MONDAY, "kept", 1), video(FRIDAY), "kept", 1),
        (video(FRIDAY), video(MONDAY, "kept", 1), "kept", 1),
    ],
)
def test_the_newest_value_counts_and_null_replaces_nothing(
    api: Any, file: Any, title: str, views: int
) -> None:
    rows = one_row_each(answers(api), answers(file), None)
    assert rows is not None
    (row,) = rows.to_pylist()
    assert (row["title"], row["view_count"], row["from_file"]) == (title, views, False)
    assert row["fetched_at"] == api["fetched_at"] or row["fetched_at"] == file["fetched_at"]


@pytest.mark.parametrize(
    ("api", "file", "said"),
    [
        ("public", "unlisted", "public"),
        ("unlisted", "public", "unlisted"),
        (None, "unlisted", "unlisted"),
        ("public", "subscriber_only", "subscriber_only"),  # which the API does not tell
        ("private", "subscriber_only", "subscriber_only"),
        ("public", None, "public"),
        (None, None, None),
    ],
)
def test_who_may_see_a_video_by_a_newer_answer_of_the_api(
    api: str | None, file: str | None, said: str | None
) -> None:
    rows = one_row_each(
        answers(video(FRIDAY, availability=api)), answers(video(MONDAY, availability=file)), None
    )
    assert rows is not None
    assert rows["availability"].to_pylist() == [said]


def test_counts_are_of_one_answer() -> None:
    api, file = video(MONDAY, "t", 1, like_count=9), video(TUESDAY, "t", 2)
    rows = one_row_each(answers(api), answers(file), answers({**video(FRIDAY), "view_count": 3}))
    assert rows is not None
    (row,) = rows.to_pylist()
    assert (row["view_count"], row["like_count"], row["counted_at"]) == (3, None, FRIDAY)
    rows = one_row_each(answers(api), answers(file), answers(video(FRIDAY, like_count=7)))
    assert rows is not None
    (row,) = rows.to_pylist()
    assert (row["view_count"], row["like_count"], row["counted_at"]) == (2, None, TUESDAY)


def test_no_file_brings_back_what_the_service_has_removed() -> None:
    gone = {"video_id": "a", "fetched_at": MONDAY, "missing": True}
    alone = {**video(FRIDAY, "t"), "video_id": "b"}
    rows = one_row_each(answers(gone), answers(video(FRIDAY, "t", 5), alone), None)
    assert rows is not None
    told = [(row["missing"], row["from_file"], row["imported"]) for row in rows.to_pylist()]
    assert told == [(True, False, True), (False, True, True)]
    assert one_row_each(None, None, answers(video(FRIDAY, views=1))) is None


def track(kind: str, *rows: list[object]) -> dict[str, object]:
    """The row of youtube/transcripts that an answer with these cues becomes."""
    answer = {
        "video_id": "a",
        "outcome": "ok",
        "kind": kind,
        "original_kind": "manual" if kind == "manual" else "asr",
        "language": "en",
        "format": parse.FORMAT,
        "cues": cues(*rows),
    }
    request = {"endpoint": "transcript", "params": {}}
    envelope = {"fetched_at": "2026-11-20T12:00:00Z", "request": request, "status": 200}
    line = json.dumps({**envelope, "response": answer}).encode()
    table = pa.concat_tables(parse.transcripts([line]))
    (row,) = with_tracks(assemble({"transcripts": table}, words=word_count))[
        "youtube/transcripts"
    ].to_pylist()
    return row


@pytest.mark.parametrize(
    ("kind", "spoken", "translate", "expected"),
    [
        ("asr", "sv", True, ("ok", "translated", "sv", "asr")),
        ("asr", "sv", False, ("none", "asr", "en", "asr")),
        ("asr", "en-GB", True, ("ok", "asr", "en", "asr")),
        ("asr", "zxx", True, ("ok", "asr", "en", "asr")),
        ("asr", None, True, ("ok", "asr", "en", "asr")),
        ("manual", "sv", False, ("ok", "manual", "en", "manual")),
    ],
)
def test_what_a_crawl_heard_in_another_language_than_the_spoken_one_is_a_translation(
    kind: str, spoken: str | None, translate: bool, expected: tuple[str, str, str, str]
) -> None:
    videos = answers(video(MONDAY)).append_column(
        "default_audio_language", pa.array([spoken], pa.string())
    )
    outcomes = pa.table(
        {
            "video_id": ["a"],
            "outcome": ["ok"],
            "kind": [kind],
            "language": ["en"],
            "original_kind": ["manual" if kind == "manual" else "asr"],
        }
    )
    (row,) = without_dubs(outcomes, videos, TrackLanguage("en", translate)).to_pylist()
    names = ("outcome", "kind", "language", "original_kind")
    assert tuple(row[name] for name in names) == expected


@pytest.mark.parametrize(
    ("times", "why"),
    [
        ([0, 0.5], "complete"),
        ([0.5, 0.5], "complete"),
        (None, "absent"),
        ([0], "mismatch"),
        ([0, 1, 2], "mismatch"),
        ([], "mismatch"),
        ("soon", "mismatch"),
        ([0, "x"], "mismatch"),
        ([0, None], "mismatch"),
        ([-1, 0.5], "negative"),
        ([0.5, 0.25], "unordered"),
    ],
)
def test_a_cue_whose_times_do_not_fit_keeps_its_text(times: object, why: str) -> None:
    row = track("asr", [0, 1, " said twice ", times], [2, 1, "fine", [2]])
    first, second = row["cues"]
    assert (first["text"], second["word_start_s"]) == (" said twice ", [2])
    assert first["word_start_s"] == (times if why == "complete" else None)
    assert row["word_times"] == why


def test_a_cue_holds_its_words() -> None:
    row = track(
        "asr", [1, 2, "a b c", [0.5, 2.5, 4]], [4.25, 1, "d e", [4.5, 5.5]], [9, 1, "f g", [9, 9.5]]
    )
    assert [(cue["start_s"], cue["duration_s"]) for cue in row["cues"]] == [
        (0.5, 3.75),
        (4.25, 2.25),
        (9, 1),
    ]


@pytest.mark.parametrize("kind", ["manual", "translated"])
def test_other_tracks_have_none(kind: str) -> None:
    row = track(kind, [0, 1, "said twice", [0, 0.5]])
    assert (row["cues"][0]["word_start_s"], row["word_times"]) == (None, None)


def test_answers_without_word_times_have_none() -> None:
    row = track("asr", [0, 1, "said twice"], [1, 1, ""])
    assert [cue["word_start_s"] for cue in row["cues"]] == [None, None]
    assert row["word_times"] == "absent"


BEFORE, AFTER = "2026-08-26T23:59:59Z", "2026-08-27T00:00:00Z"
WIDE, UPRIGHT, SQUARE, UNKNOWN = (1920, 1080), (1080, 1920), (720, 720), (None, None)


@pytest.mark.parametrize(
    ("read", "size", "duration_s", "published", "rule"),
    [
        (BEFORE, WIDE, 600, "2020-01-01T00:00:00Z", "watch_time"),
        (AFTER, WIDE, 600, "2020-01-01T00:00:00Z", "playback_start"),
        (BEFORE, UPRIGHT, 60, "2020-01-01T00:00:00Z", "playback_start"),
        (BEFORE, SQUARE, 180, "2024-10-15T00:00:00Z", "playback_start"),
        (BEFORE, UPRIGHT, 180, "2024-10-14T23:59:59Z", "watch_time"),
        (BEFORE, UPRIGHT, 181, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UNKNOWN, 30, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UPRIGHT, None, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UPRIGHT, 61, None, "watch_time"),
        ("2025-03-30T23:59:59Z", UPRIGHT, 30, "2025-01-01T00:00:00Z", "watch_time"),
        ("2025-03-31T00:00:00Z", UPRIGHT, 30, "2025-01-01T00:00:00Z", "playback_start"),
    ],
)
def test_the_rule_of_a_day(
    read: str,
    size: tuple[int | None, int | None],
    duration_s: int | None,
    published: str | None,
    rule: str,
) -> None:
    time = pa.timestamp("us", "UTC")
    rows = pa.table(
        {
            "counted_at": pa.array([_moment(read)], time),
            "published_at": pa.array([_moment(published)], time),
            "width": pa.array([size[0]], pa.int64()),
            "height": pa.array([size[1]], pa.int64()),
            "duration_s": pa.array([duration_s], pa.int64()),
        }
    )
    assert view_rule(rows).to_pylist() == [rule]


def _moment(text: str | None) -> datetime | None:
    return datetime.fromisoformat(text).astimezone(UTC) if text else None


def test_a_crawl_across_the_change_says_that_it_mixes_both(job: Job) -> None:
    job.done(*CRAWL, KB_NOW=BEFORE)
    one = job.kb("youtube", "filter", "--json", KB_NOW=BEFORE)
    assert "view counts mix" not in one.stderr
    job.done("refresh", "youtube", "--older-than", "0", "--limit", "10", KB_NOW=AFTER, code=3)
    both = job.kb("youtube", "filter", KB_NOW=AFTER)
    assert both.stderr.count("view counts mix two definitions") == 1
    counts = {
        row["view_rule"]: row["n"]
        for row in job.rows("SELECT view_rule, count(*) AS n FROM clean.youtube_videos GROUP BY 1")
    }
    assert set(counts) == {"watch_time", "playback_start"}
    job.done("youtube", "export")
    (folder,) = in_root(job.root)
    with database.asking() as con:
        sentence, *_ = gaps(con, job.root, folder)
    for rule, n in counts.items():
        assert f"those of {n:,} videos" in sentence, rule
    assert "not comparable" in sentence
    job.done("refresh", "youtube", "--older-than", "0", KB_NOW=AFTER)
    whole = job.done("youtube", "filter", KB_NOW=AFTER)
    assert set(whole["view_rules"]) == {"playback_start"}
