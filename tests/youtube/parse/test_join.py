"""All answers about a video become one row."""

from datetime import UTC, datetime
from typing import Any

import pyarrow as pa
import pytest

from kb.youtube.parse.join import one_row_each

TIME = pa.timestamp("us", "UTC")
MONDAY, TUESDAY, FRIDAY = (datetime(2026, 11, day, tzinfo=UTC) for day in (16, 17, 20))


def answers(*rows: dict[str, Any]) -> pa.Table:
    """Rows of answers; what a row does not name is null."""
    types = {
        "video_id": pa.string(),
        "title": pa.string(),
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
