"""Tests of `kb.core.source_spec`."""

from dataclasses import replace

from kb.core.source_spec import load_name
from kb.core.sources import SPECS

SPEC = replace(SPECS["reddit"], nouns={"listing": "listings", "post": "posts"}, noted=("seen",))


def test_kinds_come_in_the_order_of_work_and_unknown_ones_last() -> None:
    assert SPEC.in_order(["new_kind", "post", "seen", "listing"]) == ["listing", "post", "new_kind"]
    assert SPEC.noun("new_kind") == "new kind"


def test_what_is_left_is_counted_by_noun_without_zeros() -> None:
    kinds = {
        "post": {"todo": 2, "in_progress": 1, "done": 9},
        "listing": {"done": 1},
        "seen": {"todo": 5},
    }
    assert SPEC.left_by(kinds) == {"posts": 3}


def test_names_of_code_are_modules_or_attributes() -> None:
    assert load_name("kb.core.clock:parse") is load_name("kb.core.clock").parse
    assert load_name(".clock", "kb.core").__name__ == "kb.core.clock"
