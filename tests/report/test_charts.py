"""Charts scale to what they show."""

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from kb.look.charts import SIXTIETHS, bars, even, histogram, over_time, readable, shortened
from kb.report.data import ReportData
from tests.release.made import rows
from tests.report.made import OfOne, a_run


@pytest.mark.parametrize(
    ("low", "high", "steps", "width"),
    [
        (0, 10, (), 0.5),
        (0.9, 22.9, SIXTIETHS, 1),  # minutes
        (1, 290, SIXTIETHS, 10),
        (16, 77, (), 5),
        (-0.2, 0.31, (), 0.02),
        (3, 40_000, SIXTIETHS, 2000),
    ],
)
def test_bins_begin_and_end_at_round_numbers(
    low: float, high: float, steps: tuple[int, ...], width: float
) -> None:
    edges = even(low, high, 30, steps)
    assert edges[0] <= low < edges[1]
    assert edges[-2] < high <= edges[-1]
    assert [b - a for a, b in pairwise(edges)] == pytest.approx([width] * (len(edges) - 1))


@pytest.mark.parametrize("high", [7, 23, 90, 300, 1400])
def test_ticks_of_minutes_and_counts_are_round(high: int) -> None:
    edges = even(0, high, 30, SIXTIETHS)
    sheet = histogram(edges, [high] * (len(edges) - 1), x="minutes", y="n", steps=SIXTIETHS)
    (axes,) = sheet.axes
    (apart,) = {round(b - a, 6) for a, b in pairwise(axes.get_xticks())}
    assert apart in SIXTIETHS
    (apart,) = {round(b - a, 6) for a, b in pairwise(axes.get_yticks())}
    assert f"{apart:e}"[0] in "125"


def test_every_bar_has_its_label_and_number() -> None:
    (axes,) = bars(["a", "b"], [3, 12_345], unit="posts").axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
    assert [text.get_text() for text in axes.texts] == ["3", "12.3k"]


@pytest.mark.parametrize(
    ("periods", "named"),
    [
        ([str(year) for year in range(2001, 2024)], ["2005", "2010", "2015", "2020"]),
        (["2024"], ["2024"]),
        (["1990s", "2000s", "2010s"], ["1990s", "2000s", "2010s"]),
        (
            [f"{2022 + month // 12}-{month % 12 + 1:02}" for month in range(10, 25)],
            ["Jan\n2023", "Apr", "Jul", "Oct", "Jan\n2024"],
        ),
        ([f"{year}-{month:02}" for year in (2020, 2021, 2022, 2023) for month in range(1, 13)],
            ["2020", "2021", "2022", "2023"]),
        ([f"2026-11-{day:02}" for day in range(1, 31)],
            ["2 Nov\n2026", "9 Nov", "16 Nov", "23 Nov", "30 Nov"]),  # Mondays
        (["2026-12-31", "2027-01-01"], ["31 Dec\n2026", "1 Jan\n2027"]),
    ],
)  # fmt: skip
def test_periods_are_named_where_something_begins(periods: list[str], named: list[str]) -> None:
    (axes,) = over_time(periods, [1] * len(periods), x="time", y="n").axes
    assert [label.get_text() for label in axes.get_xticklabels()] == named


@pytest.mark.parametrize(
    ("text", "most", "short"),
    [
        ("A page about fish", 20, "A page about fish"),
        ("A page about fishing nets", 20, "A page about…"),
        ("A page about, fishing", 15, "A page about…"),
        ("Donaudampfschifffahrt", 10, "Donaudamp…"),
    ],
)
def test_what_is_shortened_ends_behind_a_word(text: str, most: int, short: str) -> None:
    assert shortened(text, most) == short


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
