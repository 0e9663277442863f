"""Keys leave an answer by what its schema says, and nothing else of it changes."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.schema.answer_keys import keys_of, without
from kb.schema.raw import at, kinds

IDS = st.lists(st.sampled_from("abcdefgh"), unique=True, max_size=8)


def videos(ids: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A request of videos.list and its answer."""
    return {"id": ",".join(ids), "part": "snippet"}, {"items": [{"id": key} for key in ids]}


@given(IDS, st.sets(st.sampled_from("abcdefgh")))
def test_what_is_left_is_what_was_asked_without_the_keys(ids: list[str], gone: set[str]) -> None:
    left = without("youtube/videos", *videos(ids), {"": gone})
    kept = [key for key in ids if key not in gone]
    assert left == (videos(kept) if kept or not ids else None)


def test_an_answer_without_the_keys_is_the_same_object() -> None:
    params, response = videos(["a", "b"])
    left = without("youtube/videos", params, response, {"": {"x"}})
    assert left is not None
    assert left[0] is params
    assert left[1] is response


def test_an_answer_about_one_key_goes_as_a_whole() -> None:
    cues: dict[str, Any] = {"video_id": "a", "cues": None}
    assert without("youtube/transcripts", {}, cues, {"": {"a"}}) is None
    assert without("youtube/transcripts", {}, cues, {"": {"b"}}) == ({}, cues)


def test_an_entry_goes_by_any_field_that_has_its_key() -> None:
    entries = [
        {"contentDetails": {"videoId": "a"}},
        {"snippet": {"resourceId": {"videoId": "b"}}},
        {"contentDetails": {}},
        "odd",
    ]
    left = without("youtube/playlist_items", {}, {"items": entries}, {"": {"a", "b"}})
    assert left == ({}, {"items": entries[2:]})


def wiki(*pages: tuple[int, str, int], **asked: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A request of the wiki's pages and its answer, from (id, title, revision)."""
    listed = [
        {"pageid": key, "title": title, "revisions": [{"revid": revision}]}
        for key, title, revision in pages
    ]
    return asked, {"query": {"pages": listed}}


def test_a_page_goes_by_its_id_or_its_title_with_all_its_names() -> None:
    net, pier, number = (1, "Net loom", 11), (2, "Long pier", 22), (3, "1", 33)
    asked = "Net loom|Long pier|1"
    left = wiki(pier, number, titles="Long pier|1")
    for gone in ({"": {"1"}}, {"title": {"Net loom"}}, {"": {"1"}, "title": {"Net loom"}}):
        assert without("wiki/pages", *wiki(net, pier, number, titles=asked), gone) == left
    ids = without("wiki/pages", *wiki(net, pier, pageids="1|2"), {"title": {"Net loom"}})
    assert ids == wiki(pier, pageids="2")
    assert without("wiki/pages", *wiki(net, revids="11"), {"": {"1"}}) is None


def test_a_title_goes_as_it_was_asked_for_too() -> None:
    params, response = wiki((1, "Café", 11), (2, "Pier", 22), titles="cafe\u0301|Pier")
    change = {"fromencoded": True, "from": "cafe%CC%81", "to": "Café"}
    response["query"]["normalized"] = [change]
    left = without("wiki/pages", params, response, {"": {"1"}})
    query = wiki((2, "Pier", 22))[1]["query"] | {"normalized": []}
    assert left == ({"titles": "Pier"}, {"query": query})


def test_a_name_that_stands_elsewhere_is_another_thing() -> None:
    file = {"key": "https://w/a.png", "title": "File:a.png", "outcome": "final"}
    assert without("wiki/files", {}, file, {"": {file["key"]}}) == ({}, file)
    assert without("wiki/files", {}, file, {"address": {file["key"]}}) is None


@pytest.mark.parametrize("kind", kinds())
def test_every_declaration_can_be_read(kind: str) -> None:
    declared = keys_of(kind)
    for entries in declared.entries:
        for place in entries.keys:
            path = f"{entries.at}[].{place.at}".replace(".0.", "[].")
            path = path.replace("pages.", "pages[].")  # a list in each page
            assert at(kind, path) is not None, path
    for place in declared.subject:
        assert at(kind, place.at) is not None, place.at
