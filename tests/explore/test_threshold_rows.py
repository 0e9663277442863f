"""Rows next to the line, and tables without the numbers of rejected rows."""

import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq

from tests.explore.conftest import Explored, explored, figures, number


def test_examples_stand_on_both_sides_of_the_line(demo_pages: Explored) -> None:
    text = demo_pages.ask("/thresholds?source=youtube&stage=views&value=500").text
    sides = [
        [
            number(views)
            for views in re.findall(r'<td class="n">([\d,]+)</td><td class="word">', part)
        ]
        for part in text.partition("Just outside</h3>")[2].split("Just inside</h3>")
    ]
    assert [len(side) for side in sides] == [20, 20]
    assert sides[0] == sorted(sides[0], reverse=True)
    assert sides[1] == sorted(sides[1])
    assert sides[0][0] < 500 <= sides[1][0]


def test_tables_of_an_older_version_are_named(demo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    shutil.copytree(demo / "data" / "demo" / "clean" / "wiki", root / "clean" / "wiki")
    (root / "clean" / "wiki" / "_manifest.json").unlink()
    for path in (root / "clean" / "wiki" / "rejected").glob("*.parquet"):
        pq.write_table(pq.read_table(path).drop_columns(["number", "other_stages"]), path)
    with explored(root) as pages:
        answer = pages.ask("/thresholds?source=wiki&value=5")
    assert (answer.status, figures(answer.text)[0]) == (200, 21)
    assert "run <code>kb wiki filter</code> again" in answer.text
