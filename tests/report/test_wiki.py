"""Figures of pages."""

from pathlib import Path

from kb.core.config.profile import load_profile
from kb.report.data import ReportData
from kb.report.wiki import FIGURES
from tests.report.made import a_run


def test_elements_are_counted_by_kind(root: Path) -> None:
    with ReportData(a_run(root)) as data:
        figure = FIGURES[2](data, load_profile("minecraft"))
        elements = data.count("wiki/elements")
    assert figure is not None
    assert figure.head == ("kind", "elements")
    assert sum(n for _, n in figure.rows) == elements
