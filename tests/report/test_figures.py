"""Figures that several sources share."""

from pathlib import Path
from typing import Any

from kb.core.config.profile import load_profile
from kb.report.data import ReportData
from kb.report.figures import funnel, toxicity
from tests.release.made import build
from tests.report.made import a_run


def test_funnel_loses_exactly_what_the_stages_dropped(root: Path) -> None:
    figure = funnel(ReportData(a_run(root)), load_profile("minecraft"), "youtube/videos")
    assert figure is not None
    assert figure.rows[0] == ("crawled", 222, 0)
    assert ("views", 157, 31) in [tuple(row) for row in figure.rows]
    assert figure.rows[-1] == ("kept", 120, 0)
    gone = [row[2] for row in figure.rows]
    left = [row[1] for row in figure.rows]
    assert all(a - g == b for a, b, g in zip(left, left[1:], gone[1:], strict=False))


def test_scores_of_kept_and_dropped_rows_meet_at_the_threshold(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "youtube/videos" else []:
            row["toxicity_title"], row["toxicity_description"] = 0.01, 0.42

    build(tmp_path, edit, sources=("youtube",), export=False, n=20)
    figure = toxicity(
        ReportData(a_run(tmp_path)),
        load_profile("minecraft"),
        "youtube/videos",
        ("toxicity_title", "toxicity_description"),
    )
    assert figure is not None
    assert [row for row in figure.rows if row[1] or row[2]] == [
        ("0.40 to 0.45", 20, 0),
        ("0.90 to 0.95", 0, 4),
    ]
    assert "dropped above 0.5" in figure.caption
