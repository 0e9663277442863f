"""Aggregates of tables."""

from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import DamagedData
from kb.report.data import ReportData
from kb.youtube.report import largest_channels
from tests.recipes import report
from tests.release.made import START, build
from tests.report.made import a_run


def cut(path: Path) -> str:
    path.write_bytes(path.read_bytes()[:100])
    return path.name


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",), export=False, n=10)
    path = tmp_path / "state" / "reddit.sqlite"
    path.parent.mkdir(exist_ok=True)
    path.write_text("garbage")
    with pytest.raises(DamagedData, match=r"reddit\.sqlite can't be read"):
        report(a_run(tmp_path))
    path.unlink()
    name = cut(next((tmp_path / "pairs").glob("p*.parquet")))
    with pytest.raises(DamagedData, match=f"pairs/{name} can't be read") as caught:
        report(a_run(tmp_path))
    assert caught.value.hint == "run `kb pairs --again`"
    assert not (tmp_path / "report").exists()


def test_posts_and_comments_share_a_rejected_table_but_no_funnel(root: Path) -> None:
    data = ReportData(a_run(root))
    posts, comments = data.funnel("reddit/posts"), data.funnel("reddit/comments")
    assert (posts[0], posts[-1]) == (("crawled", 182, 0), ("kept", 120, 0))
    assert (comments[0], comments[-1]) == (("crawled", 360, 0), ("kept", 360, 0))


def test_dates_are_counted_by_a_step_that_gives_few_bars(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for index, row in enumerate(made if name == "youtube/videos" else []):
            row["published_at"] = START + timedelta(days=index // 2) if index else None
        for index, row in enumerate(made if name == "reddit/posts" else []):
            row["created_utc"] = START.replace(year=2006 + index)

    build(tmp_path, edit, sources=("youtube", "reddit"), export=False, n=20)
    data = ReportData(a_run(tmp_path))
    step, days = data.timeline("youtube/videos", "published_at") or ("", [])
    assert (step, days[0], days[1]) == ("day", ("2026-11-01", 1), ("2026-11-02", 2))
    step, years = data.timeline("reddit/posts", "created_utc") or ("", [])
    assert (step, len(years), sum(n for _, n in years)) == ("year", 20, 20)


def test_share_of_the_channels(root: Path) -> None:
    share = largest_channels(ReportData(a_run(root)), 3)
    assert share is not None
    assert (share.videos, share.channels, share.half, len(share.largest)) == (120, 7, 4, 3)
