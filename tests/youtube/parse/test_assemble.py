"""Answers become the rows that stages judge."""

from pathlib import Path
from typing import Any

from kb.annotate.word_count import word_count_of_lists
from kb.store.rawlog.rawlog import Envelope, Request, Segment, encode, folder
from kb.youtube.parse.assemble import second_tracks


def put(root: Path, *answers: dict[str, Any]) -> None:
    """One segment of second tracks."""
    segment = Segment(folder(root, "youtube", "second_tracks"))
    for answer in answers:
        request = Request("transcript", {"video_id": answer["video_id"]})
        segment.append(encode(Envelope("2026-11-20T12:00:00Z", request, 200, answer)))
    segment.close()


def track(key: str, text: str) -> dict[str, Any]:
    about = {"video_id": key, "outcome": "ok", "reason": None, "kind": "asr", "language": "en"}
    return {**about, "original_kind": "asr", "cues": [[0, 1, text]]}


def test_second_tracks_of_a_sample_are_read_once_each(tmp_path: Path) -> None:
    put(tmp_path, track("a", "first"), {**track("b", "x"), "outcome": "none", "cues": None})
    put(tmp_path, track("a", "later"), track("c", "not asked"), track("d", "one"))
    found = [
        (row["video_id"], row["cues"][0]["text"])
        for rows in second_tracks(tmp_path, ["a", "b", "d"], word_count_of_lists)
        for row in rows.to_pylist()
    ]
    assert sorted(key for key, _ in found) == ["a", "d"]
    assert dict(found)["d"] == "one"
