"""Keys leave an answer by what its schema says, and nothing else of it changes."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from kb.schema.keys import keys_of, without
from kb.schema.raw import kinds

IDS = st.lists(st.sampled_from("abcdefgh"), unique=True, max_size=8)


def videos(ids: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A request of videos.list and its answer."""
    return {"id": ",".join(ids), "part": "snippet"}, {"items": [{"id": key} for key in ids]}


@given(IDS, st.sets(st.sampled_from("abcdefgh")))
def test_what_is_left_is_what_was_asked_without_the_keys(ids: list[str], gone: set[str]) -> None:
    left = without("youtube/videos", *videos(ids), gone)
    kept = [key for key in ids if key not in gone]
    assert left == (videos(kept) if kept or not ids else None)


def test_an_answer_without_the_keys_is_the_same_object() -> None:
    params, response = videos(["a", "b"])
    left = without("youtube/videos", params, response, {"x"})
    assert left is not None
    assert left[0] is params
    assert left[1] is response


def test_an_answer_about_one_key_goes_as_a_whole() -> None:
    assert without("youtube/transcripts", {}, {"video_id": "a", "cues": []}, {"a"}) is None
    assert without("youtube/transcripts", {}, {"video_id": "b"}, {"a"}) == ({}, {"video_id": "b"})


def test_the_first_field_that_is_there_is_the_key() -> None:
    entries = [
        {"contentDetails": {"videoId": "a"}},
        {"snippet": {"resourceId": {"videoId": "b"}}},
        {"contentDetails": {}},
        "odd",
    ]
    left = without("youtube/playlist_items", {}, {"items": entries}, {"a", "b"})
    assert left == ({}, {"items": entries[2:]})


def test_every_declaration_can_be_read() -> None:
    assert {kind for kind in kinds() if keys_of(kind).whole} >= {"youtube/transcripts"}
