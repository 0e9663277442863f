"""Charts scale to what they show."""

import re
from collections.abc import Callable
from pathlib import Path

from kb.look.charts import bars, even, over_time, readable
from kb.report.data import ReportData
from tests.release.made import rows
from tests.report.made import OfOne, a_run


def test_edges_of_bins_are_evenly_spaced() -> None:
    assert even(0, 10, 5) == [0, 2, 4, 6, 8, 10]


def test_every_bar_has_its_label_and_number() -> None:
    (axes,) = bars(["a", "b"], [3, 12_345], unit="posts").axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
    assert [text.get_text() for text in axes.texts] == ["3", "12.3k"]


def test_about_five_periods_are_named() -> None:
    (axes,) = over_time([str(year) for year in range(2000, 2024)], [1] * 24, x="year", y="n").axes
    assert [label.get_text() for label in axes.get_xticklabels()][:2] == ["2000", "2005"]


def test_labels_of_any_script_and_sign(of_one: Callable[[str], OfOne]) -> None:
    """A dollar is no formula, and what the font can't draw is a question mark, not a warning."""
    warned = [*of_one("youtube").warned, *of_one("pairs").warned]
    assert not [text for text in warned if "missing from font" in text]
    assert readable("採掘\n🧱 ok") == "?? ? ok"
    assert len(readable("a" * 80)) == 26


def test_word_cloud_counts_rows_not_mentions(root: Path) -> None:
    data = ReportData(a_run(root))
    found = dict(data.words("reddit/posts", ("title", "body"), set(), 200))
    texts = [
        set(re.findall(r"[a-z]+", f"{row['title']} {row['body']}"))
        for row in rows(120)["reddit/posts"]
    ]
    assert found["honey"] == sum("honey" in words for words in texts)
