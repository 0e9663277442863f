"""Charts scale to what they show."""

from kb.report.charts import bars, even, over_time


def test_edges_of_bins_are_evenly_spaced() -> None:
    assert even(0, 10, 5) == [0, 2, 4, 6, 8, 10]


def test_every_bar_has_its_label_and_number() -> None:
    (axes,) = bars(["a", "b"], [3, 12_345], unit="posts").axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
    assert [text.get_text() for text in axes.texts] == ["3", "12.3k"]


def test_about_five_periods_are_named() -> None:
    (axes,) = over_time([str(year) for year in range(2000, 2024)], [1] * 24, x="year", y="n").axes
    assert [label.get_text() for label in axes.get_xticklabels()][:2] == ["2000", "2005"]
