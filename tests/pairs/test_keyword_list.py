"""Tests of `kb.pairs.keyword_list`."""

from pathlib import Path

import pytest

from kb.core.errors import ProfileError
from kb.pairs.keyword_list import NEVER, read, scan

HEADER = "keyword\tkind\trule\tforms\n"


def test_rules_and_forms_of_a_row(tmp_path: Path) -> None:
    path = tmp_path / "list.tsv"
    path.write_text(
        f"# a comment\n{HEADER}Wolf\tmob\t\thound, dog\nBed\tblock\tnear\nAir\tblock\tnever\n"
        "Ice\tblock\tnear:30\n"
    )
    wolf, *others = read(path, 50)
    assert (wolf.name, wolf.kind, wolf.reach, wolf.more) == ("Wolf", "mob", None, ("hound", "dog"))
    assert [one.reach for one in others] == [50, NEVER, 30]


@pytest.mark.parametrize("line", ["Wolf", "Wolf\t", "!\tmob", "Wolf\tmob\tnaer", "a\tb\t\tc\td"])
def test_a_wrong_line_is_named_and_the_others_are_read(tmp_path: Path, line: str) -> None:
    path = tmp_path / "list.tsv"
    path.write_text(f"{HEADER}{line}\nBed\tblock\n")
    rows, problems = scan(path, 50)
    assert [row.line for row in rows] == [3]
    assert [one.line for one in problems] == [2]
    with pytest.raises(ProfileError):
        read(path, 50)
