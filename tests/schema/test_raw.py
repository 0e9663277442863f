"""Raw answers against their JSON Schemas: recorded ones pass, unknown keys are counted,
wrong ones named.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema.validators import Draft7Validator

from kb.core.errors import UsageError
from kb.core.installation import folder
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
    "minimum",
    "minItems",
    "maxItems",
    "additionalProperties",
}
FOLDERS = {
    "search": "youtube/search",
    "playlist_items": "youtube/playlist_items",
    "videos": "youtube/videos",
}


def problems(kind: str, answer: Any) -> list[str]:
    """What an answer has that its schema does not allow, by another reader of JSON Schema."""
    return [error.message for error in Draft7Validator(draft7(raw.raw(kind))).iter_errors(answer)]


def draft7(schema: Any) -> Any:
    """The same schema in the newest words that the tests' library knows."""
    if isinstance(schema, list):
        return [draft7(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    newer = {"prefixItems": "items"}
    return {newer.get(key, key): draft7(one) for key, one in schema.items() if key != "$schema"}


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
        answer = json.loads(path.read_text(encoding="utf-8"))
        assert problems(f"youtube/{kind}", answer) == [], path.name
        assert not raw.unknown_keys(f"youtube/{kind}", answer), path.name


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
        assert problems(f"reddit/{kind}", answer) == []
        assert not raw.unknown_keys(f"reddit/{kind}", answer)
        seen[kind] += 1
    assert set(seen) == {"comments", "info", "morechildren", "listings"}
    retyped = {
        "kind": "Listing",
        "data": {"children": [{"kind": "t3", "data": {"id": "a", "score": "many", "aura": 1}}]},
    }
    assert problems("reddit/info", retyped) == ["'many' is not of type 'integer', 'null'"]
    assert dict(raw.unknown_keys("reddit/info", retyped)) == {"data.children[].data.aura": 1}


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
        answer = json.loads(path.read_text(encoding="utf-8"))
        assert problems(f"wiki/{kind}", answer) == [], path.name
        assert not raw.unknown_keys(f"wiki/{kind}", answer), path.name


def video(**change: Any) -> dict[str, Any]:
    item: dict[str, Any] = {"id": "a", "snippet": {"title": "t"}, "statistics": {"viewCount": "1"}}
    return {"items": [item, item | change]}


def test_unknown_keys_are_counted_not_refused() -> None:
    odd = video(
        snippet={"mood": 1, "thumbnails": {"vast": {}}},  # thumbnails may have any
        contentDetails={"contentRating": {"x": 1}},
        madeUp={"a": 1},
    ) | {"more": 1}
    assert dict(raw.unknown_keys("youtube/videos", odd)) == {
        "items[].snippet.mood": 1,
        "items[].madeUp": 1,
        "more": 1,
    }
    assert not raw.unknown_keys("youtube/videos", "cut")
    assert not raw.unknown_keys("youtube/videos", {"items": "no list"})


CUES = {"start_s": [0.0], "duration_s": [1.5], "text": ["hi"]}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({}, None),
        ({"cues": {**CUES, "text": [2.0]}}, "2.0 is not of type 'string'"),
        ({"cues": {"start_s": [0.0], "text": ["x"]}}, "'duration_s' is a required property"),
        ({"outcome": "maybe"}, "'maybe' is not one of"),
        ({"video_id": None}, "None is not of type 'string'"),
    ],
)
def test_a_transcript_s_schema(change: dict[str, Any], problem: str | None) -> None:
    good = {
        "video_id": "a",
        "outcome": "ok",
        "kind": "asr",
        "language": "en",
        "cues": CUES,
        "player": {"fps": 30},
    }
    found = problems("youtube/transcripts", good | change)
    assert any(one.startswith(problem) for one in found) if problem else not found


def test_an_unknown_kind_names_the_known() -> None:
    with pytest.raises(UsageError) as caught:
        raw.raw("youtube/video")
    assert "youtube/videos" in caught.value.hint


def test_schemas_are_valid_json_schema() -> None:
    for path in (folder("schemas") / "raw").glob("*/*.json"):
        schema = json.loads(path.read_text(encoding="utf-8"))
        Draft7Validator.check_schema(draft7(schema))
