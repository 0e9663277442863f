"""Tests of `kb.schema.nested_elements`."""

import pytest

from kb.schema.nested_elements import ancestors, is_outermost


@pytest.mark.parametrize(
    ("chain", "wanted"),
    [
        (["text"], True),
        (["text", "text"], False),
        (["cell", "text"], False),
        (["text", "image", "text"], False),
        (["text", "image"], True),
        (["text", "table", "text"], True),
        (["cell", "table"], True),
        (["text", "cell", "table"], False),
    ],
)
def test_a_text_counts_where_no_other_one_of_its_table_contains_it(
    chain: list[str], wanted: bool
) -> None:
    """`chain` lists the kinds from the element to the outermost one around it."""
    kinds = dict(enumerate(chain))
    parents = {at: at + 1 for at in kinds}
    assert list(ancestors(0, parents)) == list(kinds)[1:]
    assert is_outermost(0, parents, kinds) == wanted


def test_parents_that_form_a_cycle_end() -> None:
    assert list(ancestors(1, {1: 2, 2: 3, 3: 2})) == [2, 3]
    assert list(ancestors(1, {1: 1})) == []
    assert list(ancestors(1, {1: None})) == []
