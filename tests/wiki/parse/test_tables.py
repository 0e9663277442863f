"""Tests of `kb.wiki.parse.tables`."""

from typing import Any

from kb.wiki.parse import tables


def test_a_cycle_of_parents_contains_nothing() -> None:
    def entry(number: int, kind: str, parent: int | None) -> dict[str, Any]:
        text = f"t{number}"
        return {"id": number, "kind": kind, "parent": parent, "visible": True, "text": text}

    ring = [entry(1, "other", 2), entry(2, "other", 1), entry(3, "text", 1), entry(4, "text", 3)]
    assert tables.page_text(ring) == "t3"
