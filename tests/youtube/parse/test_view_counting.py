"""view_rule says how a count was made; a crawl that mixes both rules says so."""

from datetime import UTC, datetime

import pyarrow as pa
import pytest

from kb.release.folders import in_root
from kb.store.tables import database
from kb.youtube.card import gaps
from kb.youtube.parse.view_counting import view_rule
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job

BEFORE, AFTER = "2026-08-26T23:59:59Z", "2026-08-27T00:00:00Z"
WIDE, UPRIGHT, SQUARE, UNKNOWN = (1920, 1080), (1080, 1920), (720, 720), (None, None)


@pytest.mark.parametrize(
    ("read", "size", "duration_s", "published", "rule"),
    [
        (BEFORE, WIDE, 600, "2020-01-01T00:00:00Z", "watch_time"),
        (AFTER, WIDE, 600, "2020-01-01T00:00:00Z", "playback_start"),
        (BEFORE, UPRIGHT, 60, "2020-01-01T00:00:00Z", "playback_start"),
        (BEFORE, SQUARE, 180, "2024-10-15T00:00:00Z", "playback_start"),
        (BEFORE, UPRIGHT, 180, "2024-10-14T23:59:59Z", "watch_time"),
        (BEFORE, UPRIGHT, 181, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UNKNOWN, 30, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UPRIGHT, None, "2025-01-01T00:00:00Z", "watch_time"),
        (BEFORE, UPRIGHT, 61, None, "watch_time"),
        ("2025-03-30T23:59:59Z", UPRIGHT, 30, "2025-01-01T00:00:00Z", "watch_time"),
        ("2025-03-31T00:00:00Z", UPRIGHT, 30, "2025-01-01T00:00:00Z", "playback_start"),
    ],
)
def test_the_rule_of_a_day(
    read: str,
    size: tuple[int | None, int | None],
    duration_s: int | None,
    published: str | None,
    rule: str,
) -> None:
    time = pa.timestamp("us", "UTC")
    rows = pa.table(
        {
            "counted_at": pa.array([_moment(read)], time),
            "published_at": pa.array([_moment(published)], time),
            "width": pa.array([size[0]], pa.int64()),
            "height": pa.array([size[1]], pa.int64()),
            "duration_s": pa.array([duration_s], pa.int64()),
        }
    )
    assert view_rule(rows).to_pylist() == [rule]


def _moment(text: str | None) -> datetime | None:
    return datetime.fromisoformat(text).astimezone(UTC) if text else None


def test_a_crawl_across_the_change_says_that_it_mixes_both(job: Job) -> None:
    job.done(*CRAWL, KB_NOW=BEFORE)
    one = job.kb("youtube", "filter", "--json", KB_NOW=BEFORE)
    assert "view counts mix" not in one.stderr
    job.done("refresh", "youtube", "--older-than", "0", "--limit", "10", KB_NOW=AFTER, code=3)
    both = job.kb("youtube", "filter", KB_NOW=AFTER)
    assert both.stderr.count("view counts mix two definitions") == 1
    counts = {
        row["view_rule"]: row["n"]
        for row in job.rows("SELECT view_rule, count(*) AS n FROM clean.youtube_videos GROUP BY 1")
    }
    assert set(counts) == {"watch_time", "playback_start"}
    job.done("youtube", "export")
    (folder,) = in_root(job.root)
    with database.asking() as con:
        (sentence,) = gaps(con, folder)
    for rule, n in counts.items():
        assert f"those of {n:,} videos" in sentence, rule
    assert "not comparable" in sentence
    job.done("refresh", "youtube", "--older-than", "0", KB_NOW=AFTER)
    whole = job.done("youtube", "filter", KB_NOW=AFTER)
    assert set(whole["view_rules"]) == {"playback_start"}
