"""Tests of `kb.schema.struct_lists`."""

from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData
from kb.schema import coerce, struct_lists
from kb.schema.types import parse_type
from tests.schema.json_values import good_cues, odd_cues

CUES = parse_type("list<struct<start_s: float64, duration_s: float64, text: string>>")


def as_columns(values: list[Any]) -> tuple[Any, list[tuple[int, str]]]:
    return struct_lists.records(
        struct_lists.texts([struct_lists.verbatim(value) for value in values]), CUES
    )


def cell_by_cell(values: list[Any]) -> tuple[list[Any], list[tuple[int, str]]]:
    """What a list of cues is, cell by cell: the rule that columns must come to as well."""
    made: list[Any] = []
    bad: list[tuple[int, str]] = []
    for row, value in enumerate(values):
        try:
            made.append(None if value is None else [_cue(cue) for cue in _a_list(value)])
        except (TypeError, ValueError, OverflowError):
            made.append(None)
            bad.append((row, coerce.shown(value)))
    return made, bad


def _cue(cue: Any) -> dict[str, Any]:
    start, length, text = _a_list(cue)
    for one in (start, length):
        if isinstance(one, bool) or not isinstance(one, int | float):
            raise TypeError
    if not isinstance(text, str):
        raise TypeError
    plain = "".join("\ufffd" if c == "\0" or "\ud800" <= c <= "\udfff" else c for c in text)
    return {"start_s": float(start), "duration_s": float(length), "text": plain}


def _a_list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError
    return value


@settings(max_examples=200)
@given(st.lists(good_cues, max_size=4), st.lists(good_cues | odd_cues, max_size=4))
def test_cues_as_columns_are_the_cues_cell_by_cell(good: list[Any], odd: list[Any]) -> None:
    values = [*good, *odd]
    column, bad = as_columns(values)
    expected, expected_bad = cell_by_cell(values)
    assert repr(column.to_pylist()) == repr(expected)  # by repr: NaN is NaN, -0.0 is not 0.0
    assert bad == expected_bad
    column.validate(full=True)


def test_one_odd_list_of_cues_costs_that_list_only() -> None:
    huge = 10**400  # no float holds it
    values = [[[0, 1.5, "a"]], [[huge, 1, "b"]], None, [[True, 1, "c"]], [], [[2**53 + 1, 1, "d"]]]
    column, bad = as_columns(values)
    assert [row for row, _ in bad] == [1, 3]
    assert column.to_pylist() == [
        [{"start_s": 0.0, "duration_s": 1.5, "text": "a"}],
        None,
        None,
        None,
        [],
        [{"start_s": 2.0**53, "duration_s": 1.0, "text": "d"}],
    ]


@pytest.mark.parametrize(
    ("cues", "starts"),
    [
        (b'[[-0,1,"a"]]', [0.0]),
        (b'[[1e400,1,"a"]]', [float("inf")]),
        (b'[[1E-3,1,"a"], [2.50,1,"\xc3\xa9"]]', [0.001, 2.5]),
        (b'[[1,1,"\xed\xa0\x80"]]', [1.0]),  # half of a pair, as some write it
        (b"[[1,1]]", None),
        (b'[[1,1,"a",2]]', None),
        (b"{}", None),
    ],
)
def test_numbers_and_texts_as_json_may_write_them(cues: bytes, starts: list[float] | None) -> None:
    column, bad = struct_lists.records(
        struct_lists.texts([msgspec.Raw(b"null"), msgspec.Raw(cues)]), CUES
    )
    nothing, one = column.to_pylist()
    assert nothing is None
    assert (one and repr([cue["start_s"] for cue in one])) == (starts and repr(starts))
    assert [row for row, _ in bad] == ([] if starts else [1])


def test_a_list_that_is_no_text_is_damage() -> None:
    with pytest.raises(DamagedData, match="not an envelope"):
        struct_lists.texts([msgspec.Raw(b'[[1,1,"\xff"]]')])
