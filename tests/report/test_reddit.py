"""Figures of posts."""

from pathlib import Path

from kb.core.config.profile import load_profile
from kb.report.data import ReportData
from kb.report.reddit import FIGURES
from tests.report.made import a_run


def test_types_add_up_to_the_kept_posts(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = FIGURES[1](data, load_profile("minecraft"))
    assert figure is not None
    assert sum(n for _, n in figure.rows) == 120
