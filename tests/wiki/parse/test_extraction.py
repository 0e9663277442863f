"""Extractions decoded into types are the tables that they are field by field."""

import json
from pathlib import Path
from typing import Any

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.wiki.parse import extraction, facts, tables

number = st.integers(-5, 2**40) | st.floats(-1e6, 1e6)
words = st.text("ab \n♪é\0", max_size=9)
box = st.tuples(*[number] * 4).map(list)
kinds = st.sampled_from(["text", "cell", "table", "image", "sprite", "animation", "other"])
ELEMENT = {
    "kind": kinds,
    "parent": st.none() | st.integers(0, 5),
    "tag": words,
    "region": words,
    "level": st.none() | st.integers(1, 6) | st.sampled_from([2.0]),
    "text": st.none() | words,
    "box": box,
    "visible": st.booleans(),
}
MORE = {
    "alt": st.none() | words,
    "caption": words,
    "crop": st.none() | st.tuples(number, number).map(list),
    "lines": st.none() | st.lists(box, max_size=2),
    "src": st.none() | st.sampled_from(["data:x", "https://w/images/a.png", ""]),
    "frames": st.none() | st.lists(st.just({"src": "https://w/images/a.png", "duration": 50.4})),
    "brand_new": words,
}
CELL = {
    "table": st.integers(0, 5),
    "row": st.integers(0, 5),
    "column": st.integers(0, 5) | st.just(3.0),
    "rowspan": st.integers(1, 3),
    "colspan": st.integers(1, 3),
    "header": st.booleans(),
    "text": words,
    "box": box | st.lists(number, min_size=5, max_size=5),
}
PAGE = {"width": 1280, "height": 900, "viewport_width": 1280.0, "device_pixel_ratio": 1}


@st.composite
def extractions(draw: st.DrawFn) -> dict[str, Any]:
    elements = draw(st.lists(st.fixed_dictionaries(ELEMENT, optional=MORE), max_size=5))
    cells = draw(st.lists(st.fixed_dictionaries(CELL), max_size=4))
    found = {
        "page": PAGE,
        # What holds an element comes before it.
        "elements": [
            element | {"id": at, "parent": None if at == 0 else (element["parent"] or 0) % at}
            for at, element in enumerate(elements)
        ],
        "cells": cells,
    }
    return found | draw(st.sampled_from([{}, {"sprites": {"0": "ab"}, "facts": []}]))


def made(found: Any) -> list[Any]:
    rules = facts.MarkupRules()
    return [
        tables.elements([(7, found.elements)], rules).to_pylist(),
        tables.cells([(7, found.cells)]).to_pylist(),
        tables.image_rows(7, found, {}),
        tables.page_text(found.elements),
        (found.page, found.sprites, found.facts, found.recipes),
    ]


@settings(max_examples=200)
@given(extractions())
def test_typed_records_make_the_same_tables(tmp_path_factory: Any, held: dict[str, Any]) -> None:
    folder: Path = tmp_path_factory.getbasetemp()
    text = json.dumps(held).encode()
    (folder / "extraction.json.zst").write_bytes(zstandard.compress(text))
    careful = extraction._careful(json.loads(text))
    assert repr(made(extraction.read(folder, folder))) == repr(made(careful))


def test_an_element_without_a_field_is_a_defect_that_shows(tmp_path: Path) -> None:
    held = {"page": PAGE, "cells": [], "elements": [{"id": 1, "kind": "text"}]}
    (tmp_path / "extraction.json.zst").write_bytes(zstandard.compress(json.dumps(held).encode()))
    with pytest.raises(KeyError, match="parent"):
        extraction.read(tmp_path, tmp_path)
