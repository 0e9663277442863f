"""Archive dumps: every line of the subreddit once, whatever the file is like, also after
SIGKILL.
"""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Toxicity
from kb.core.errors import LimitReached
from kb.core.progress import LineProgress
from kb.filters.filter_run import run_clean
from kb.reddit.crawl.importer import _side_by_side, import_dumps
from kb.reddit.dumps.import_file import ImportJob
from kb.reddit.dumps.search import CHECKED
from kb.reddit.parse.anonymize import load_key
from tests.reddit.dumped import archived, imported, imported_rows, post, run_in, write
from tests.reddit.work import rows as read_rows


def test_only_the_subreddit_and_no_name_stays(tmp_path):
    other = post("bbb", subreddit="gardening", title='all about "Minecraft"', author="tidy_pebble")
    dump = write(
        tmp_path / "RS_2020-09.zst", [post("aaa"), other, post("ccc", subreddit="MINECRAFT")]
    )
    summary = import_dumps(run_in(tmp_path), [dump])
    assert (summary["crawled"], summary["lines"], summary["bad_lines"], summary["requests"]) == (
        2,
        3,
        0,
        0,
    )
    assert [data["id"] for _, data in imported(tmp_path)] == ["aaa", "ccc"]
    assert not any(
        b"brisk_otter" in path.read_bytes()
        for path in tmp_path.rglob("*")
        if path.is_file() and path != dump
    )
    assert len(imported(tmp_path)[0][1]["author"]) == 32


def test_damaged_lines_are_counted_and_the_rest_is_taken(tmp_path):
    lines = [
        post("aaa"),
        b"no json at all",
        b'{"id": "x", "subreddit": "Minecraft", "title": "cu',
        post("bbb"),
        b'{"subreddit": "pics", "ti',
        post("ccc"),
    ]
    summary = import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", lines)])
    assert (
        summary["crawled"],
        summary["bad_lines"],
        summary["lines"],
        summary["truncated_files"],
    ) == (3, 3, 6, 0)


def test_damage_far_behind_the_beginning_is_counted_and_the_first_place_is_said(tmp_path, capsys):
    other = json.dumps(post("x", subreddit="gardening", selftext="leaf " * 200)).encode()
    before = [other] * (CHECKED // len(other) + 500)
    lines = [
        *before,
        b"garbage",
        other,
        b'["Minecraft"]',
        b'{"subreddit": "pics", "ti',
        other,
        b'{"subreddit": "Minecraft", broken}',
        b"",
        other,
        post("last"),
    ]
    summary = import_dumps(
        run_in(tmp_path, progress=LineProgress()), [write(tmp_path / "RS.zst", lines)]
    )
    assert (summary["crawled"], summary["lines"], summary["bad_lines"]) == (1, len(lines), 4)
    assert (
        f"skipped 4 damaged lines, the first at byte {len(before) * (len(other) + 1)} "
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "said", ["1700000000000", "²", "٣", -1, 1e300, "9" * 30, float("nan"), True]
)
def test_a_date_of_reading_that_is_none_is_null(tmp_path, said):
    import_dumps(
        run_in(tmp_path),
        [write(tmp_path / "RS.zst", [post("odd", retrieved_on=said), post("good")])],
    )
    assert {row["fullname"]: row["fetched_at"] for row in imported_rows(tmp_path)} == {
        "t3_odd": None,
        "t3_good": "2020-09-14T16:13:20Z",
    }


def test_frames_that_are_to_be_skipped_hold_nothing(tmp_path):
    """As pzstd writes them."""
    dump = write(tmp_path / "RS.zst", [post("a"), post("b")], frames=2)
    extra = b"\x50\x2a\x4d\x18" + (70_000).to_bytes(4, "little") + bytes(70_000)
    dump.write_bytes(extra + dump.read_bytes() + extra)
    assert import_dumps(run_in(tmp_path), [dump])["truncated_files"] == 0
    assert [data["id"] for _, data in imported(tmp_path)] == ["a", "b"]


def test_fields_of_old_dumps(tmp_path):
    old = {
        "id": "old1",
        "subreddit": "Minecraft",
        "author": "[deleted]",
        "title": "Iron &amp; gold &lt;3",
        "selftext": "a &gt; b",
        "is_self": True,
        "score": 12,
        "created_utc": "1300000000",
        "retrieved_utc": 1_300_086_400,
    }
    comment = {
        "id": "c1",
        "subreddit": "Minecraft",
        "author": "x",
        "body": "yes &amp; no",
        "link_id": "t3_old1",
        "parent_id": "t3_old1",
        "created_utc": "1300000100",
        "score": 2,
    }
    import_dumps(
        run_in(tmp_path), [write(tmp_path / "RS.zst", [old]), write(tmp_path / "RC.zst", [comment])]
    )
    found = {row["fullname"]: row for row in imported_rows(tmp_path)}
    first = found["t3_old1"]
    assert (
        first["title"],
        first["text"],
        first["created_utc"].timestamp(),
        first["author_hash"],
    ) == (
        "Iron & gold <3",
        "a > b",
        1_300_000_000,
        None,
    )
    assert first["fetched_at"] == "2011-03-14T07:06:40Z"
    # a dump that doesn't say when it was read
    assert (found["t1_c1"]["text"], found["t1_c1"]["fetched_at"], found["t1_c1"]["live"]) == (
        "yes & no",
        None,
        False,
    )


def test_each_record_has_its_own_date_of_reading_or_none(tmp_path):
    never = {"retrieved_on": None}
    import_dumps(
        run_in(tmp_path),
        [
            write(
                tmp_path / "RS.zst",
                [post("n1", **never), post("n2", retrieved_on=1_600_000_000, upvote_ratio="0.95")],
            )
        ],
    )
    found = {row["post_id"]: row for row in imported_rows(tmp_path)}
    assert (found["n1"]["fetched_at"], found["n2"]["fetched_at"]) == (None, "2020-09-13T12:26:40Z")
    assert (found["n2"]["upvote_ratio"], found["n2"]["problems"]) == (0.95, [])


@pytest.mark.parametrize("order", [1, -1])
def test_where_no_date_is_said_the_later_dump_counts_in_whatever_order_they_came(tmp_path, order):
    early = write(
        tmp_path / "RS_2020-01.zst",
        [post("a", score=10, retrieved_on=None), post("a", score=11, retrieved_on=None)],
    )
    late = write(
        tmp_path / "RS_2024-01.zst",
        [
            post("a", score=98, retrieved_on=None),
            *[post("b")] * 300,
            post("a", score=99, retrieved_on=None),
        ],
    )
    for dump in (early, late)[::order]:
        import_dumps(run_in(tmp_path), [dump])
    profile = load_profile("minecraft")
    profile = profile.model_copy(update={"toxicity": Toxicity(toxicity="off")})
    assert run_clean(replace(run_in(tmp_path), profile=profile), "reddit")["duplicates"] == 302
    assert [
        (row["post_id"], row["score"]) for row in read_rows(tmp_path / "clean" / "reddit" / "posts")
    ] == [("a", 99), ("b", 7)]


def test_limit_goes_on_where_it_stopped(tmp_path):
    dumps = [
        write(tmp_path / f"RS_{n}.zst", [post(f"f{n}p{m}") for m in range(30)]) for n in range(2)
    ]
    for taken in (25, 25):
        with pytest.raises(LimitReached) as stopped:
            import_dumps(run_in(tmp_path, limit=25), dumps)
        assert stopped.value.summary["crawled"] == taken
        lines = stopped.value.summary["lines"]
    assert lines == 50, "lines behind the last thing taken were counted"
    assert import_dumps(run_in(tmp_path), dumps)["crawled"] == 10
    assert sorted(data["id"] for _, data in imported(tmp_path)) == sorted(
        f"f{n}p{m}" for n in range(2) for m in range(30)
    )


GB = 10**9


class Counted(ThreadPoolExecutor):
    """How many tasks were handed out and not taken back yet, at most."""

    most = 0

    def __init__(self) -> None:
        super().__init__(4)
        self.out: list[Any] = []

    def submit(self, *task: Any, **options: Any) -> Any:
        self.out = [future for future in self.out if not future.done()]
        future = super().submit(*task, **options)
        self.out.append(future)
        self.most = max(self.most, len(self.out))
        return future


@pytest.mark.parametrize(("gb", "together"), [(3, 1), (1, 1), (5, 2)])
def test_two_wide_dumps_are_read_at_once_only_where_both_fit(
    tmp_path: Path, gb: int, together: int
) -> None:
    files = [archived(tmp_path / f"RS_{n}.zst", f"k{n}") for n in range(5)]
    jobs = [ImportJob(str(tmp_path), str(file), "minecraft", 0, 4e9, 0) for file in files]
    load_key(tmp_path)
    with Counted() as pool:
        cursors = list(_side_by_side(jobs, pool, window=4, most=gb * GB))
    assert pool.most <= together
    assert [cursor.fresh for cursor in cursors] == [1] * 5
    assert sorted(data["id"] for _, data in imported(tmp_path)) == [f"k{n}" for n in range(5)]
