"""Figures of pairs."""

from pathlib import Path

from kb.core.config.profile import load_profile
from kb.report import pairs
from kb.report.data import ReportData
from tests.report.made import a_run


def test_pair_lengths_count_every_pair(root: Path) -> None:
    figure = pairs.lengths(ReportData(a_run(root)), load_profile("minecraft"))
    assert figure is not None
    assert sum(n for _, n in figure.rows) == 240
