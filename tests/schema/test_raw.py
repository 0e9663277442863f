"""Raw answers against their JSON Schemas: recorded ones pass, unknown keys are counted,
wrong ones named.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import UsageError
from kb.core.resources import folder
from kb.schema import raw

ALLOWED = {
    "x-keys",
    "x-copied-from",
    "$schema",
    "title",
    "description",
    "type",
    "properties",
    "required",
    "items",
    "prefixItems",
    "enum",
    "format",
    "pattern",
    "minItems",
    "maxItems",
    "additionalProperties",
}
FOLDERS = {
    "search": "youtube/search",
    "playlist_items": "youtube/playlist_items",
    "videos": "youtube/videos",
    "channels": "youtube/channels",
}


def words(schema: Any) -> set[str]:
    found = set(schema)
    for inner in schema.get("properties", {}).values():
        found |= words(inner)
    for inner in [
        *schema.get("prefixItems", []),
        *([schema["items"]] if "items" in schema else []),
    ]:
        found |= words(inner)
    return found


@pytest.mark.parametrize("kind", raw.kinds())
def test_only_what_check_understands_is_used(kind: str) -> None:
    schema = raw.raw(kind)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["description"]
    assert words(schema) <= ALLOWED


@pytest.mark.parametrize("kind", FOLDERS)
def test_recorded_answers_have_no_unknown_key_and_no_problem(kind: str, recorded: Path) -> None:
    paths = sorted((recorded / FOLDERS[kind]).glob("*.json"))
    assert paths
    for path in paths:
        found = raw.check(f"youtube/{kind}", json.loads(path.read_text(encoding="utf-8")))
        assert (found.problems, dict(found.unknown)) == ([], {}), path.name


def reddit_answers(recorded: Path) -> Iterator[tuple[str, Any]]:
    """(kind, answer) of every recorded answer that holds posts, comments or stubs;
    subreddits and users are not ours.
    """
    for path in sorted((recorded / "reddit").glob("*.json")):
        for exchange in json.loads(path.read_text(encoding="utf-8"))["interactions"]:
            uri, text = exchange["request"]["uri"], exchange["response"]["body"]["string"]
            answer = json.loads(text) if text.startswith(("{", "[")) else None
            if isinstance(answer, list) and "/comments/" in uri:
                yield "comments", answer
            elif isinstance(answer, dict) and "/api/morechildren" in uri:
                yield "morechildren", answer
            elif isinstance(answer, dict) and answer.get("kind") == "Listing":
                children = answer["data"]["children"]
                answer["data"]["children"] = [
                    child for child in children if child["kind"] in ("t1", "t3", "more")
                ]
                yield "info" if "/api/info" in uri else "listings", answer


def test_recorded_answers_of_reddit_have_no_unknown_key_and_no_problem(recorded: Path) -> None:
    seen = Counter()
    for kind, answer in reddit_answers(recorded):
        found = raw.check(f"reddit/{kind}", answer)
        assert (found.problems, dict(found.unknown)) == ([], {})
        seen[kind] += 1
    assert set(seen) == {"comments", "info", "morechildren", "listings"}
    retyped = {
        "kind": "Listing",
        "data": {"children": [{"kind": "t3", "data": {"id": "a", "score": "many", "aura": 1}}]},
    }
    found = raw.check("reddit/info", retyped)
    assert found.problems == ['data.children[0].data.score is "many", not integer or null']
    assert dict(found.unknown) == {"data.children[].data.aura": 1}


WIKI = {
    "titles": "allpages-",
    "pages": ("pages", "page-", "contributors-", "generator-", "missing", "redirect"),
    "imageinfo": "imageinfo",
    "site": "siteinfo",
}


@pytest.mark.parametrize("kind", WIKI)
def test_recorded_answers_of_a_wiki_have_no_unknown_key_and_no_problem(
    kind: str, recorded: Path
) -> None:
    paths = [
        path
        for path in sorted((recorded / "wiki" / "api").rglob("*.json"))
        if path.parent.name != "parse" and path.name.startswith(WIKI[kind])
    ]
    assert paths
    for path in paths:
        found = raw.check(f"wiki/{kind}", json.loads(path.read_text(encoding="utf-8")))
        assert (found.problems, dict(found.unknown)) == ([], {}), path.name


def video(**change: Any) -> dict[str, Any]:
    item: dict[str, Any] = {"id": "a", "snippet": {"title": "t"}, "statistics": {"viewCount": "1"}}
    return {"items": [item, item | change]}


@pytest.mark.parametrize(
    ("response", "problem"),
    [
        (video(id=None), "items[1].id is null, not string"),
        (video(snippet={"title": 3}), "items[1].snippet.title is 3, not string"),
        (video(snippet="gone"), 'items[1].snippet is "gone", not object'),
        (video(statistics={"viewCount": 12}), "items[1].statistics.viewCount is 12, not string"),
        (
            video(statistics={"viewCount": "-5"}),
            'items[1].statistics.viewCount is "-5", which does not match ^[0-9]+$',
        ),
        (video(snippet={"tags": ["a", 1]}), "items[1].snippet.tags[1] is 1, not string"),
        (video(status={"embeddable": 1}), "items[1].status.embeddable is 1, not boolean"),
        ({"items": [{}]}, "items[0].id is missing"),
        ({}, "items is missing"),
        ("cut off", 'the answer is "cut off", not object'),
    ],
)
def test_a_wrong_field_is_named_with_what_was_found(response: Any, problem: str) -> None:
    assert raw.check("youtube/videos", response).problems == [problem]


def test_unknown_keys_are_counted_not_refused() -> None:
    found = raw.check("youtube/videos", video(snippet={"mood": 1}, madeUp={"a": 1}) | {"more": 1})
    assert found.problems == []
    assert dict(found.unknown) == {"items[].snippet.mood": 1, "items[].madeUp": 1, "more": 1}


def test_the_fast_look_for_unknown_keys_sees_the_same(recorded: Path) -> None:
    odd = video(
        snippet={"mood": 1, "thumbnails": {"vast": {}}},
        contentDetails={"contentRating": {"x": 1}},
        madeUp={"a": 1},
    ) | {"more": 1}
    answers = [
        ("youtube/videos", odd),
        ("youtube/videos", "cut"),
        ("youtube/videos", {"items": "no list"}),
    ]
    player = json.loads(
        (recorded / "youtube/transcripts/youtube.innertube.json").read_text(encoding="utf-8")
    )
    for kind, answer in [*answers, ("youtube/player", player)]:
        assert raw.unknown_keys(kind, answer) == raw.check(kind, answer).unknown
    assert raw.unknown_keys("youtube/player", player)["streamingData.adaptiveFormats[].url"] > 10


@pytest.mark.parametrize(
    "name",
    [
        "youtube.innertube.json",
        "youtube_age_restricted.innertube.json",
        "youtube_video_unavailable.innertube.json",
        "youtube_transcripts_disabled2.innertube.json",
    ],
)
def test_pick_keeps_no_address_of_anything(name: str, recorded: Path) -> None:
    answer = json.loads((recorded / "youtube" / "transcripts" / name).read_text(encoding="utf-8"))
    kept = raw.pick("youtube/player", answer)
    text = json.dumps(kept)
    assert not re.search(
        r"https?:|//|visitor|2001:db8|INNERTUBE|signature|trackingParams|expire",
        text,
        re.IGNORECASE,
    )
    assert len(text) < 8_000
    assert kept["playabilityStatus"]["status"] == answer["playabilityStatus"]["status"]
    if name == "youtube.innertube.json":
        assert (
            max(
                form["width"]
                for form in kept["streamingData"]["adaptiveFormats"]
                if "width" in form
            )
            == 3840
        )
        tracks = kept["captions"]["playerCaptionsTracklistRenderer"]["captionTracks"]
        assert [track.get("kind") for track in tracks].count("asr") == 1
        assert len(tracks) == 9


def test_pick_lets_nothing_in_under_a_declared_name() -> None:
    sly = {
        "videoDetails": {"videoId": {"url": "https://x"}, "lengthSeconds": "5"},
        "captions": "https://x",
    }
    assert raw.pick("youtube/player", sly) == {"videoDetails": {"lengthSeconds": "5"}}


def test_transcripts_outcome() -> None:
    good = {
        "video_id": "a",
        "outcome": "ok",
        "kind": "asr",
        "language": "en",
        "cues": [[0.0, 1.5, "hi"]],
        "player": {"fps": 30},
    }
    assert raw.check("youtube/transcripts", good).problems == []
    assert raw.check("youtube/transcripts", good | {"cues": [[0.0, "x"]]}).problems == [
        "cues[0] has 2 items",
        'cues[0][1] is "x", not number',
    ]
    assert (
        raw.check("youtube/transcripts", good | {"outcome": "maybe"})
        .problems[0]
        .startswith('outcome is "maybe", none of')
    )


def test_an_unknown_kind_names_the_known() -> None:
    with pytest.raises(UsageError) as caught:
        raw.raw("youtube/video")
    assert "youtube/videos" in caught.value.hint


def test_schemas_are_valid_json_schema() -> None:
    from jsonschema.validators import (
        Draft7Validator,
    )  # the oldest the tests' library knows; the words used mean the same

    for path in (folder("schemas") / "raw").glob("*/*.json"):
        schema = json.loads(path.read_text(encoding="utf-8"))
        Draft7Validator.check_schema(
            {key: value for key, value in schema.items() if key != "$schema"}
        )
