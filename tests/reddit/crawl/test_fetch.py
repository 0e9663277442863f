"""Tests of the requests for each kind of item."""

from collections import Counter

import pytest

from kb.sandbox.reddit.subreddit import CASES
from tests.reddit.work import Work


def test_pages_are_read_once_and_stubs_by_the_hundred(whole: Work) -> None:
    paths = [seen.path for seen in whole.asked]
    pages = Counter(path for path in paths if path.startswith("/comments/"))
    assert set(pages.values()) == {1}
    deep, wide = (
        list(whole.world.posts)[CASES.index("deep")],
        list(whole.world.posts)[CASES.index("wide")],
    )
    assert sum(path.startswith(f"/comments/{deep}/_/") for path in pages) == 4  # ten replies a page
    assert sum("morechildren" in path for path in paths) == 7  # 500 of 1,200 are on the page
    assert sum(path.startswith(f"/comments/{wide}/") for path in pages) == 1
    asked = sum(path.startswith(("/r/", "/comments/", "/api/")) for path in paths)
    assert whole.crawled["requests"] == asked


@pytest.mark.parametrize("status", [403, 404])
def test_a_post_that_is_shut_or_gone_is_a_fact_and_no_failure(work: Work, status: int) -> None:
    post = list(work.world.posts)[4]
    work.sandbox.faults.add(
        f"^/comments/{post}/", status=status, body={"message": "no", "error": status}, times=None
    )
    summary = work.crawl()
    assert (summary["failed"], summary["missing"]) == (0, 1)
    work.filter()
    rejected = {row["key"]: row["stage"] for row in work.table("clean", "reddit", "rejected")}
    kept = {f"t3_{row['post_id']}" for row in work.table("clean", "reddit", "posts")}
    assert (f"t3_{post}" in kept) == (status == 403)
    assert rejected.get(f"t3_{post}") == ("missing" if status == 404 else None)


def test_stubs_that_lead_nowhere_are_missing(work: Work) -> None:
    wide = list(work.world.posts)[CASES.index("wide")]
    lost = [
        key for key, comment in work.world.comments.items() if comment["link_id"] == f"t3_{wide}"
    ][-3:]
    work.sandbox.faults.add(
        "morechildren", then=lambda seen: work.world.gone.update(f"t1_{key}" for key in lost)
    )
    work.crawl()
    work.filter()
    rejected = {
        row["key"]: (row["stage"], row["reason"])
        for row in work.table("clean", "reddit", "rejected")
    }
    assert {rejected[f"t1_{key}"] for key in lost} == {("missing", "missing")}
