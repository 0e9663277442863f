"""What services were asked."""

from pathlib import Path
from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.report import build
from kb.report.data import ReportData
from tests.report.made import a_run


def test_quota_adds_up_by_day(root: Path) -> None:
    figure = build.quota(ReportData(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sorted(tuple(row) for row in figure.rows) == sorted(
        [
            (f"2026-11-0{day}", f"youtube {bucket}", day * units)
            for day in (1, 2, 3)
            for bucket, units in (("general", 5), ("search", 1))
        ]
    )


def test_each_service_has_a_scale_of_its_own(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty units beside six: each panel is as high as its own largest day."""
    sheets: list[Any] = []
    monkeypatch.setattr(build, "saved", lambda sheet: sheets.append(sheet) or {})
    build.quota(ReportData(a_run(root)), load_profile("minecraft"))
    tops = [panel.get_ylim()[1] for panel in sheets[0].axes]
    assert [panel.get_title(loc="left") for panel in sheets[0].axes] == [
        "YouTube: general",
        "YouTube: search",
    ]
    assert [panel.get_ylabel() for panel in sheets[0].axes] == ["units", "units"]
    assert tops == pytest.approx([15 * 1.08, 3 * 1.08])
