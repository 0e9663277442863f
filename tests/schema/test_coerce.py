"""Conversions of raw values, over everything that JSON can hold."""

import json
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st

from kb.schema import coerce, table
from kb.schema.decode import ColumnReader
from kb.schema.types import parse_type
from tests.schema.json_values import (
    anything,
    digits,
    moments,
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
    ((rows, _),) = reader.tables([json.dumps(envelope).encode()], 10)
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
