"""One literal row for each reason of each stage, and what the kept ones look like in each
layout.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.pipeline import Recipe
from kb.sandbox.invented_ids import ELSEWHERE
from kb.sandbox.reddit.subreddit import CASES
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.raw import comment, listing, post, write
from tests.reddit.work import Work, texts

POSTS = [  # the post, then stage, reason, value, threshold; None: kept
    (post("good"), None),
    (post("at5", score=5), None),
    (post("low", score=4), ("score", "below", "4", "5")),
    (post("none", score="LEFT OUT"), ("score", "absent", None, "5")),
    (post("odd", score="many"), ("score", "malformed", "many", "5")),
    (post("txt", score="12"), None),
    (post("adult", over_18=True), ("nsfw", "over_18", None, None)),
    (post("adult1", over_18=1), ("nsfw", "over_18", None, None)),
    (post("adultword", over_18="True"), ("nsfw", "over_18", None, None)),
    (post("child0", over_18=0), None),
    (post("childword", over_18="false"), None),
    (post("nobodysays", over_18="LEFT OUT"), ("nsfw", "absent", None, None)),
    (post("nullsays", over_18=None), ("nsfw", "absent", None, None)),
    (post("perhaps", over_18="maybe"), ("nsfw", "malformed", "maybe", None)),
    (
        post("del", selftext="[deleted]", removed_by_category="deleted"),
        ("removed", "deleted", None, None),
    ),
    (
        post("mod", selftext="[removed]", removed_by_category="moderator"),
        ("removed", "removed", None, None),
    ),
    (post("untitled", title="LEFT OUT"), ("removed", "absent", None, None)),
    (post("undated", created_utc="LEFT OUT"), ("missing", "absent", None, None)),
    (post("baddate", created_utc="yesterday"), ("missing", "malformed", "yesterday", None)),
]
NAMELESS = (post("", id="LEFT OUT"), post("", id=123456))
COMMENTS = [
    (comment("c_good"), None),
    (comment("c_reply", parent_id="t1_c_del"), None),
    (comment("c_del", body="[deleted]", author="[deleted]"), ("removed", "deleted", None, None)),
    (comment("c_mod", body="[removed]"), ("removed", "removed", None, None)),
    (comment("c_void", body="LEFT OUT"), ("removed", "absent", None, None)),
    (comment("c_low", link_id="t3_low", parent_id="t3_low"), ("post", "not_kept", None, None)),
    (
        comment("c_lost", link_id="t3_nowhere", parent_id="t3_nowhere"),
        ("post", "absent", None, None),
    ),
    (comment("c_orphan", parent_id="1.7"), ("missing", "malformed", "1.7", None)),
    (comment("c_root", parent_id="LEFT OUT"), ("missing", "absent", None, None)),
]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Work:
    """The rows above as raw answers, filtered; and info that was asked for two more names, and a
    stub.
    """
    with (
        pytest.MonkeyPatch.context() as patch,
        Sandbox(small_world(1), services=["reddit"]) as sandbox,
    ):
        patch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
        work = Work(sandbox, tmp_path_factory.mktemp("judged"))
        stub = {
            "kind": "more",
            "data": {"id": "c_more", "children": ["c_more"], "parent_id": "t3_good", "count": 1},
        }
        write(work.root, "listings", {}, listing(*(thing for thing, _ in POSTS), *NAMELESS))
        write(
            work.root,
            "comments",
            {"article": "good"},
            [listing(*(thing for thing, _ in COMMENTS), stub)],
        )
        write(work.root, "info", {"id": "t3_gone,t1_c_gone", "posts": ["gone", "good"]}, listing())
        work.filtered = work.filter()
        return work


def verdict(work: Work, name: str) -> dict[str, Any] | None:
    return next(
        (row for row in work.table("clean", "reddit", "rejected") if row["key"] == name), None
    )


GONE = [
    (post("gone"), ("missing", "missing", None, None)),
    (comment("c_gone"), ("missing", "missing", None, None)),
]


@pytest.mark.parametrize(
    ("thing", "expected"),
    [*POSTS, *COMMENTS, *GONE],
    ids=lambda value: value["data"]["id"] if isinstance(value, dict) else "",
)
def test_each_row_gets_its_verdict(
    judged: Work, thing: dict[str, Any], expected: tuple[Any, ...] | None
) -> None:
    key, table = thing["data"]["id"], "posts" if thing["kind"] == "t3" else "comments"
    row = verdict(judged, f"{thing['kind']}_{key}")
    kept = {row[f"{table[:-1]}_id"] for row in judged.table("clean", "reddit", table)}
    assert (key in kept) == (expected is None)
    if expected is None:
        assert row is None
    else:
        stage, reason, value, threshold = expected
        assert row is not None
        assert (row["stage"], row["reason"]) == (stage, reason)
        if value is not None:
            assert row["value"] == value
        if threshold is not None:
            assert row["threshold"] == threshold


@pytest.mark.parametrize(("reason", "value"), [("absent", None), ("malformed", "123456")])
def test_what_has_no_readable_id_says_so(judged: Work, reason: str, value: str | None) -> None:
    found = [
        row
        for row in judged.table("clean", "reddit", "rejected")
        if row["key"].startswith("t3_unknown-")
    ]
    assert [(row["stage"], row["value"]) for row in found if row["reason"] == reason] == [
        ("missing", value)
    ]


def test_a_stub_that_was_not_resolved_waits(judged: Work) -> None:
    assert judged.table("clean", "reddit", "pending") == [{"key": "t1_c_more", "reason": "more"}]
    summary = judged.filtered
    assert (
        summary["crawled"]
        == len(POSTS) + len(NAMELESS) + len(COMMENTS) + 3
        == summary["kept"] + summary["rejected"] + summary["failed"] + summary["pending"]
    )


def test_depth_counts_deleted_ancestors_too(judged: Work) -> None:
    depth = {row["comment_id"]: row["depth"] for row in judged.table("clean", "reddit", "comments")}
    assert depth == {"c_good": 0, "c_reply": 1}


def test_the_stages_stand_in_the_contracts_order() -> None:
    from kb.core.config.profile import load_profile

    made, p = Recipe("reddit"), load_profile("minecraft")
    for stages, order in (
        (made.defined("posts")(p), ["missing", "removed", "nsfw", "score", "toxicity"]),
        (made.defined("comments")(p), ["missing", "post", "removed", "toxicity"]),
    ):
        assert list(dict.fromkeys(stage.stage for stage in stages)) == order


def test_each_case_of_the_subreddit_is_what_it_is(whole: Work) -> None:
    kept = {row["post_id"]: row for row in whole.table("clean", "reddit", "posts")}
    types = {
        "text": ("text", None),
        "image": ("image", "image"),
        "image_album": ("image", "image"),
        "image_direct": ("image", "image"),
        "video_hosted": ("video", "video"),
        "video_youtube": ("video", "video"),
        "video_gifv": ("video", "video"),
        "link": ("link", "general"),
        "poll": ("poll", None),
        "gallery": ("gallery", None),
        "crosspost": ("video", "video"),
        "link_video_page": ("link", "general"),
        "empty_text": ("text", None),
    }
    for number, key in enumerate(list(whole.world.posts)[: len(CASES)]):
        case = CASES[number]
        assert (key in kept) == (
            case not in ("low_score", "nsfw", "removed", "deleted", "no_score")
        ), case
        if case in types:
            assert (kept[key]["type"], kept[key]["link_kind"]) == types[case], case
    poll = list(whole.world.posts)[CASES.index("poll")]
    options = [one["text"] for one in whole.world.posts[poll]["poll_data"]["options"]]
    assert kept[poll]["poll_options"] == options
    assert "&" in options[1]
    crosspost = kept[list(whole.world.posts)[CASES.index("crosspost")]]
    assert (crosspost["is_crosspost"], crosspost["source_url"]) == (
        True,
        f"https://v.redd.it/{ELSEWHERE}",
    )


def test_the_release_has_ids_and_figures_and_nothing_else(whole: Work) -> None:
    allowed = {
        "posts": {
            "post_id",
            "type",
            "created_utc",
            "score",
            "num_comments",
            "comments_released",
            "comments_unread",
            "upvote_ratio",
            "score_source",
            "fetched_at",
        },
        "comments": {
            "comment_id",
            "post_id",
            "parent_id",
            "parent_comment_id",
            "depth",
            "parent_in_release",
            "created_utc",
            "score",
            "score_source",
            "fetched_at",
        },
    }
    for name, columns in allowed.items():
        found = [
            row
            for path in sorted((whole.root / "release" / "reddit").glob(f"{name}-*.parquet"))
            for row in rows_of(path)
        ]
        assert set(found[0]) == columns
        assert [row[f"{name[:-1]}_id"] for row in found] == [
            row[f"{name[:-1]}_id"] for row in whole.table("clean", "reddit", name)
        ]
    text = " ".join(texts(whole.root / "release").values())
    for row in whole.table("clean", "reddit", "posts"):
        assert json.dumps(row["title"])[1:-1] not in text
        assert row["author_hash"] is None or row["author_hash"] not in text
        assert row["source_url"] is None or row["source_url"] not in text


def rows_of(path: Path) -> list[dict[str, Any]]:
    import pyarrow.parquet as pq

    return pq.read_table(path).to_pylist()


def test_mine_dojos_list_is_the_published_form(whole: Work) -> None:
    found = json.loads((whole.root / "export" / "minedojo" / "reddit.json").read_text())
    posts = whole.table("clean", "reddit", "posts")
    # MineDojo's loader knows these four; a poll's content is its text, a gallery's its address.
    known = {name: name for name in ("text", "image", "video", "link")}
    as_there = {**known, "poll": "text", "gallery": "image"}
    assert found == [{"id": row["post_id"], "type": as_there[row["type"]]} for row in posts]
    assert {"poll", "gallery"} <= {row["type"] for row in posts}


def test_names_are_hashed_the_same_everywhere_and_only_here(whole: Work) -> None:
    by_name: dict[str, set[str]] = {}
    for row in whole.table("clean", "reddit", "comments"):
        by_name.setdefault(whole.world.comments[row["comment_id"]]["author"], set()).add(
            row["author_hash"]
        )
    assert all(len(hashes) == 1 for hashes in by_name.values())
    assert len(set().union(*by_name.values())) == len(by_name) > 5
