"""Figures of videos."""

from pathlib import Path

import duckdb

from kb.core.config.profile import load_profile
from kb.report import youtube
from kb.report.data import ReportData
from tests.report.made import a_run


def test_durations_end_at_the_percentile_of_the_profile(root: Path) -> None:
    data, profile = ReportData(a_run(root)), load_profile("minecraft")
    figure = youtube.durations(data, profile)
    files = [str(path) for path in (root / "clean" / "youtube" / "videos").glob("*.parquet")]
    limit = (
        duckdb.connect()
        .execute("SELECT quantile_disc(duration_s, 0.85) FROM read_parquet(?)", [files])
        .fetchone()[0]
    )
    shown = (
        duckdb.connect()
        .execute("SELECT count(*) FROM read_parquet(?) WHERE duration_s <= ?", [files, limit])
        .fetchone()[0]
    )
    assert figure is not None
    assert sum(n for _, n in figure.rows) == shown
    assert 0.84 <= shown / 120 <= 0.87
    assert f"{limit / 60:.1f} minutes" in figure.caption
