"""The stage `topic`: what shows that a video is about the domain."""

from typing import Any

import pyarrow as pa
import pytest

from kb.filters.predicates import AtLeast
from kb.youtube.topic import Topic, whole_words
from tests.filters.test_predicates import PROBLEMS, bad


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("my MINECRAFT!", True),
        ("minecrafts", False),
        ("Minecraft", True),
        ("éminecraft", False),
        ("the マインクラフト x", True),
        ("今日もマインクラフトで遊ぶ", True),
        ("Minecraftで遊ぶ", True),
        ("Let's play\tguide", False),
        ("a  block\nhouse", True),
        ("C++ mods", True),
        ("C+ mods", False),
        ("", False),
        ("#minecraft", True),
        ("minecraft2", False),
    ],
)
def test_whole_words(text: str, found: bool) -> None:
    import pyarrow.compute as pc

    pattern = whole_words(["Minecraft", "マインクラフト", "block house", "c++"])
    assert pc.match_substring_regex(pa.array([text]), pattern).to_pylist() == [found]


GAME = "UCgame"


OTHER = "UCother"


def topic_row(**change: Any) -> tuple[pa.Table, Topic]:
    """One video, and the stage by the profile's rules."""
    row = {
        "category_id": 20,
        "title": "a title",
        "tags": [],
        "description": "",
        "game_label_id": None,
        "game_label": None,
        "transcript_outcome": "ok",
        "view_count": 500,
        "problems": [],
    } | change
    game_ids, known = row.pop("game_ids", (GAME,)), row.pop("imported_known", False)
    types = {
        "category_id": pa.int64(),
        "view_count": pa.int64(),
        "tags": pa.list_(pa.string()),
        "problems": PROBLEMS,
        "imported": pa.bool_(),
    }
    rows = pa.table(
        {name: pa.array([value], types.get(name, pa.string())) for name, value in row.items()}
    )
    gate = (AtLeast("view_count", 100, stage="views"),)
    return rows, Topic(game_ids, (20,), ("Minecraft",), gate, imported_known=known)


def topic(**change: Any) -> tuple[Any, Any, Any, Any]:
    """(evidence, reason, value, verdict) of one video under the profile's rules."""
    rows, stage = topic_row(**change)
    rows = stage.fill(rows)
    judged = stage.judge(rows)
    verdict = judged.verdict if isinstance(judged.verdict, str) else judged.verdict[0].as_py()
    return (
        rows["topic_evidence"][0].as_py(),
        judged.reason[0].as_py(),
        judged.value[0].as_py(),
        verdict,
    )


@pytest.mark.parametrize(
    ("change", "matched", "unmatched"),
    [
        ({"game_label_id": OTHER, "game_label": "Roblox", "title": "Minecraft"},
         "category 20, keyword in title", "label Roblox"),
        ({"game_label_id": OTHER, "category_id": 10}, None, "label UCother, category 10, keywords"),
        ({"category_id": 10, "tags": ["a", "minecraft"]}, "keyword in tags", "category 10"),
        ({"category_id": None, "description": "of Minecraft"}, "keyword in description",
         "category"),
        ({"title": "Minecraftesque"}, "category 20", "keywords"),
    ],
)  # fmt: skip
def test_a_topic_that_fails_says_what_matched_and_what_did_not(
    change: dict[str, Any], matched: str | None, unmatched: str
) -> None:
    rows, stage = topic_row(**change)
    held, did_not = stage.conditions(stage.fill(rows))
    assert held[0].as_py() == matched
    assert did_not[0].as_py() == unmatched.replace("UCother", OTHER)


@pytest.mark.parametrize(
    ("change", "evidence", "reason", "value", "verdict"),
    [
        # a known label decides, whatever else the video says
        ({"game_label_id": GAME, "game_label": "Minecraft"}, "game_label", None, None, "rejected"),
        ({"game_label_id": GAME, "category_id": 22}, "game_label", None, None, "rejected"),
        ({"game_label_id": GAME, "category_id": None}, "game_label", None, None, "rejected"),
        (
            {"game_label_id": OTHER, "game_label": "Roblox", "title": "Minecraft"},
            None,
            "other_game",
            "Roblox",
            "rejected",
        ),
        ({"game_label_id": OTHER, "title": "Minecraft"}, None, "other_game", OTHER, "rejected"),
        # no label on the page: category and a keyword
        ({"title": "my minecraft house"}, "keywords", None, None, "rejected"),
        ({"tags": ["games", "Minecraft"]}, "keywords", None, None, "rejected"),
        ({"description": "all about MINECRAFT."}, "keywords", None, None, "rejected"),
        ({}, None, "keywords", None, "rejected"),
        ({"category_id": 22, "title": "Minecraft"}, None, "category", "22", "rejected"),
        ({"category_id": None, "title": "Minecraft"}, None, "absent", None, "rejected"),
        (
            {"category_id": None, "problems": bad("category_id", "x")},
            None,
            "malformed",
            "x",
            "rejected",
        ),
        # the label was not read yet and would be
        ({"transcript_outcome": None, "title": "Minecraft"}, "keywords", "label", None, "pending"),
        ({"transcript_outcome": None}, None, "label", None, "pending"),
        ({"transcript_outcome": "failed"}, None, "label", None, "failed"),
        # it will never be read: the video does not pass the cheap stages, or is of another category
        ({"transcript_outcome": None, "view_count": 5}, None, "keywords", None, "rejected"),
        (
            {"transcript_outcome": None, "view_count": 5, "title": "Minecraft"},
            "keywords",
            None,
            None,
            "rejected",
        ),
        ({"transcript_outcome": None, "category_id": 22}, None, "category", "22", "rejected"),
        # a domain without a game id
        (
            {"game_ids": (), "transcript_outcome": None, "title": "Minecraft"},
            "keywords",
            None,
            None,
            "rejected",
        ),
        (
            {"game_ids": (), "game_label_id": OTHER, "title": "Minecraft"},
            "keywords",
            None,
            None,
            "rejected",
        ),
    ],
)
def test_topic(
    change: dict[str, Any],
    evidence: str | None,
    reason: str | None,
    value: str | None,
    verdict: str,
) -> None:
    got = topic(**change)
    assert got[:3] == (evidence, reason, value)
    if reason is not None:
        assert got[3] == verdict


@pytest.mark.parametrize(
    ("change", "evidence", "reason"),
    [
        ({"imported": True}, "profile", None),
        ({"imported": True, "category_id": None, "title": "Minecraft"}, "profile", None),
        ({"imported": True, "transcript_outcome": None}, "profile", None),  # no label is waited for
        ({"imported": True, "game_label_id": GAME}, "game_label", None),
        ({"imported": True, "game_label_id": OTHER, "title": "Minecraft"}, None, "other_game"),
        ({"imported": False, "title": "Minecraft"}, "keywords", None),
        ({"imported": False}, None, "keywords"),
    ],
)
def test_an_imported_video_is_meant_where_the_profile_says_so(
    change: dict[str, Any], evidence: str | None, reason: str | None
) -> None:
    assert topic(imported_known=True, **change)[:2] == (evidence, reason)
