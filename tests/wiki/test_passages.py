"""Tests of `kb.wiki.passages`."""

import pytest

from kb.wiki.passages import grid, link


def test_a_table_has_a_line_for_each_row_with_words() -> None:
    cells = [
        {"table_id": table, "row_index": row, "text": text}
        for table, row, text in ((1, 0, "Name"), (1, 0, "Drops"), (1, 1, None), (2, 0, " bone "))
    ]
    assert grid(cells) == {1: ["Name | Drops"], 2: ["bone"]}


@pytest.mark.parametrize(
    ("url", "anchor", "wanted"),
    [
        ("https://w/Wolf", "", "https://w/Wolf?oldid=7"),
        (
            "https://w/index.php?title=Wolf",
            "Caf\u00e9_1",
            "https://w/index.php?title=Wolf&oldid=7#Caf%C3%A9_1",
        ),
    ],
)
def test_a_link_names_the_revision_and_the_section(url: str, anchor: str, wanted: str) -> None:
    assert link(url, 7, anchor) == wanted
