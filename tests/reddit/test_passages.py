"""Tests of `kb.reddit.passages`."""

from datetime import UTC, datetime
from pathlib import Path

from kb.core.config.profile import load_profile
from kb.reddit.passages import passages
from tests.search.made import write

NOON = datetime(2023, 1, 1, 12, tzinfo=UTC)


def test_a_post_without_a_body_is_a_passage_and_its_comments_follow(tmp_path: Path) -> None:
    posts = [
        {"post_id": key, "type": "text", "title": f"Title {key}", "created_utc": NOON}
        for key in ("a", "b")
    ]
    comment = {"comment_id": "c", "post_id": "a", "parent_id": "t3_a", "created_utc": NOON}
    write(tmp_path, "reddit/posts", posts)
    write(tmp_path, "reddit/comments", [{**comment, "body": "feed\nthe wolf"}])
    made = list(passages(load_profile("minecraft"), tmp_path))
    assert [(one.key, one.thing, one.title, one.text) for one in made] == [
        ("t3_a", "a", "Title a", ""),
        ("t1_c", "a", "Title a", "feed\nthe wolf"),
        ("t3_b", "b", "Title b", ""),
    ]
    assert made[1].url.endswith("/comments/a/_/c/")
    assert made[1].date == "2023-01-01"
