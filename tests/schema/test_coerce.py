"""Conversions of raw values, over everything that JSON can hold."""

import json
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kb.schema import coerce, table
from kb.schema.decode import ColumnReader, decoded
from kb.schema.tables import parse_type
from tests.schema.json_values import (
    anything,
    digits,
    good_cues,
    in_columns,
    moments,
    odd_cues,
)

counts = st.none() | st.integers(0, 2**63 - 1).map(str)
STRING = {"type": "string"}


@given(st.lists(anything | counts))
def test_counts_are_decimal_digits_and_nothing_else(values: list[Any]) -> None:
    column, bad = coerce.coerce(values, parse_type("int64"), STRING)
    assert column.to_pylist() == [int(value) if digits(value) else None for value in values]
    assert [row for row, _ in bad] == [
        row for row, value in enumerate(values) if value is not None and not digits(value)
    ]


@given(st.lists(st.tuples(*[st.integers(0, 10**6)] * 5)))
def test_durations_are_summed(parts: list[tuple[int, ...]]) -> None:
    texts = [f"P{w}W{d}DT{h}H{m}M{s}S" for w, d, h, m, s in parts]
    column, bad = coerce.coerce(texts, parse_type("int64"), STRING | {"format": "duration"})
    assert bad == []
    assert column.to_pylist() == [
        (((w * 7 + d) * 24 + h) * 60 + m) * 60 + s for w, d, h, m, s in parts
    ]


@given(st.lists(anything))
def test_no_duration_raises_or_is_negative(values: list[Any]) -> None:
    column, bad = coerce.coerce(values, parse_type("int64"), STRING | {"format": "duration"})
    assert all(value is None or value >= 0 for value in column.to_pylist())
    assert column.null_count == len(bad) + values.count(None)


@given(st.lists(moments), st.sampled_from(["Z", ".000Z", ".%fZ"]))
def test_both_recorded_forms_of_a_time(when: list[datetime], form: str) -> None:
    when = [one if "%f" in form else one.replace(microsecond=0) for one in when]
    column, bad = coerce.times([one.strftime("%Y-%m-%dT%H:%M:%S" + form) for one in when])
    assert bad == []
    assert column.to_pylist() == [one.replace(tzinfo=UTC) for one in when]


@given(st.lists(moments), st.integers(-14 * 60, 14 * 60))
def test_times_with_an_offset_are_utc(when: list[datetime], minutes: int) -> None:
    zone = timezone(timedelta(minutes=minutes))
    column, bad = coerce.times([one.replace(tzinfo=zone).isoformat() for one in when])
    assert bad == []
    assert column.to_pylist() == [one.replace(tzinfo=zone).astimezone(UTC) for one in when]


@given(st.lists(anything))
def test_texts_hold_no_nul_and_no_surrogate(values: list[Any]) -> None:
    column, bad = coerce.texts(values)
    for value, got in zip(values, column.to_pylist(), strict=True):
        assert (got is not None) == isinstance(value, str)
        assert got is None or (
            len(got) == len(value) and "\0" not in got and got.encode() is not None
        )
    assert all("\0" not in text and len(text) <= 200 for _, text in bad)


def at(path: list[str], value: Any) -> Any:
    for step in reversed(path):
        value = {step: value}
    return value


@settings(max_examples=150)
@given(st.data())
def test_any_value_in_any_place_costs_that_value_only(data: st.DataObject) -> None:
    reader = ColumnReader(table("youtube/videos"), "videos")
    columns = [column for column in reader.columns if column.name != "video_id"]
    path = data.draw(
        st.sampled_from(
            [column.source.path.removeprefix("items[].").split(".") for column in columns]
        )
    )
    path = path[: data.draw(st.integers(1, len(path)))]
    value = data.draw(anything)
    other = {"id": "b", "statistics": {"viewCount": "5"}, "contentDetails": {"duration": "PT9S"}}
    envelope = {
        "fetched_at": "2026-11-20T12:00:00Z",
        "request": {"params": {}},
        "status": 200,
        "response": {"items": [{"id": "a"} | at(path, value), other]},
    }
    ((rows, _),) = reader.tables([json.dumps(envelope).encode()])
    a, b = rows.to_pylist()
    assert (a["video_id"], b["video_id"], b["view_count"], b["duration_s"], b["problems"]) == (
        "a",
        "b",
        5,
        9,
        [],
    )


@given(st.lists(anything | st.floats(0, 1e20) | st.integers(0, 10**20)))
@example([10**17])
def test_no_number_of_seconds_raises(values: list[Any]) -> None:
    column, bad = coerce.unix_times(values)
    lost = [row for row, got in enumerate(column.to_pylist()) if got is None]
    assert [row for row, _ in bad] == [row for row in lost if values[row] is not None]


CUES = parse_type("list<struct<start_s: float64, duration_s: float64, text: string>>")


def cell_by_cell(values: list[Any]) -> tuple[list[Any], list[tuple[int, str]]]:
    """What cues are, cell by cell: the rule that whole columns must come to as well."""
    made: list[Any] = []
    bad: list[tuple[int, str]] = []
    for row, value in enumerate(values):
        try:
            made.append(None if value is None else _cues(value))
        except (TypeError, ValueError, LookupError, OverflowError):
            made.append(None)
            bad.append((row, coerce.shown(value)))
    return made, bad


def _cues(value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, dict):
        raise TypeError
    columns = [_a_list(value[name]) for name in ("start_s", "duration_s", "text")]
    return [_cue(*cells) for cells in zip(*columns, strict=True)]


def _cue(start: Any, length: Any, text: Any) -> dict[str, Any]:
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
    column, bad = coerce.coerce(values, CUES, {})
    expected, expected_bad = cell_by_cell(values)
    assert repr(column.to_pylist()) == repr(expected)  # by repr: NaN is NaN, -0.0 is not 0.0
    assert bad == expected_bad
    column.validate(full=True)


def test_one_odd_list_of_cues_costs_that_list_only() -> None:
    huge = 10**400  # no float holds it
    rows = [[(0, 1.5, "a")], [(huge, 1, "b")], [(True, 1, "c")], [], [(2**53 + 1, 1, "d")]]
    values = [in_columns(one) for one in rows]
    values.insert(2, None)
    column, bad = coerce.coerce(values, CUES, {})
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
        (b'[-0],"duration_s":[1],"text":["a"]', [0.0]),
        (b'[1e400],"duration_s":[1],"text":["a"]', [float("inf")]),
        (b'[1E-3,2.50],"duration_s":[1,1],"text":["a","\xc3\xa9"]', [0.001, 2.5]),
        (b'[1],"duration_s":[1],"text":["\xed\xa0\x80"]', [1.0]),  # half of a pair
        (b'[1],"duration_s":[1]', None),
        (b'[1],"duration_s":[1],"text":["a",2]', None),
        (b"7", None),
    ],
)
def test_numbers_and_texts_as_json_may_write_them(cues: bytes, starts: list[float] | None) -> None:
    column, bad = coerce.coerce([None, decoded(b'{"start_s":%s}' % cues)], CUES, {})
    nothing, one = column.to_pylist()
    assert nothing is None
    assert (one and repr([cue["start_s"] for cue in one])) == (starts and repr(starts))
    assert [row for row, _ in bad] == ([] if starts else [1])


WORDS = parse_type("list<struct<start_s: float64, text: string, word_start_s: list<float64>>>")


def test_a_list_of_numbers_may_be_left_out_and_an_odd_one_is_empty() -> None:
    values: list[dict[str, Any]] = [
        {"start_s": [0, 1, 2], "text": ["a b", "c", "d"], "word_start_s": [[0, 0.5], None, None]},
        {"start_s": [3], "text": ["e"], "word_start_s": [["x"]]},
        {"start_s": [4], "text": ["f"], "word_start_s": [[True]]},
        {"start_s": [5], "text": ["g"], "word_start_s": None},
        {"start_s": [6], "text": ["h"]},
    ]
    column, bad = coerce.coerce(values, WORDS, {})
    assert bad == []
    starts = [[row["word_start_s"] for row in rows] for rows in column.to_pylist()]
    assert starts == [[[0.0, 0.5], None, None], [[]], [[]], [None], [None]]
