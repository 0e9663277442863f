"""Figures of sources and pairs: their rows add up to those of the tables."""

from pathlib import Path

import duckdb
import pytest

from kb.core.config.profile import load_profile
from kb.core.sources import SOURCES
from kb.report import derived
from kb.report.data import ReportData
from kb.youtube.report import durations
from tests.report.made import a_run


@pytest.mark.parametrize(
    ("figure", "table"),
    [
        (SOURCES["wiki"].figures()[2], "wiki/elements"),
        (SOURCES["reddit"].figures()[1], "reddit/posts"),
        (derived.lengths, "pairs/pairs"),
    ],
)
def test_a_figure_counts_every_row(root: Path, figure: object, table: str) -> None:
    with ReportData(a_run(root)) as data:
        made = figure(data, load_profile("minecraft"))
        rows = data.count(table)
    assert sum(n for _, n in made.rows) == rows > 0


def test_the_quality_of_pairs_is_what_the_table_says(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = derived.quality(data, load_profile("minecraft"))
        files = data.files("pairs/quality")
    counts = dict(figure.rows)
    with duckdb.connect() as con:
        ((verbs, timed, low, high),) = con.execute(
            "SELECT count(*) FILTER (has_verb), count(interpolation_error_s),"
            " quantile_cont(interpolation_error_s, 0.25),"
            " quantile_cont(interpolation_error_s, 0.75)"
            " FROM read_parquet(?)",
            [files],
        ).fetchall()
    assert counts["verb near the keyword"] == verbs > 0
    assert counts["time of the word known"] == timed > 0
    assert f"half of them between {low:.2f} and {high:.2f} seconds" in figure.caption


def test_durations_end_at_the_percentile_of_the_profile(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = durations(data, load_profile("minecraft"))
        videos = data.files("youtube/videos")
    with duckdb.connect() as con:
        ((limit, shown),) = con.execute(
            "WITH v AS (SELECT duration_s AS d FROM read_parquet(?)),"
            " m AS (SELECT quantile_disc(d, 0.85) AS high FROM v)"
            " SELECT any_value(high), count(*) FROM v, m WHERE d <= high",
            [videos],
        ).fetchall()
    assert sum(n for _, n in figure.rows) == shown
    assert 0.84 <= shown / 120 <= 0.87
    assert f"{limit / 60:.1f} minutes" in figure.caption
