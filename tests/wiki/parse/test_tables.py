"""Tests of `kb.wiki.parse.tables`."""

from types import SimpleNamespace

from kb.wiki.parse import tables


def test_parents_that_go_round_in_a_ring_hold_nothing() -> None:
    def entry(number: int, kind: str, parent: int | None) -> SimpleNamespace:
        return SimpleNamespace(id=number, kind=kind, parent=parent, visible=True, text=f"t{number}")

    ring = [entry(1, "other", 2), entry(2, "other", 1), entry(3, "text", 1), entry(4, "text", 3)]
    assert tables.page_text(ring) == "t3"
