"""Conversions of raw values, over everything that JSON can hold."""

import json
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData
from kb.schema import coerce, struct_lists, table
from kb.schema.decode import ColumnReader
from kb.schema.types import parse_type
from kb.youtube.parse import answers as parse

scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text()
)
anything = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
counts = st.none() | st.integers(0, 2**63 - 1).map(str)
STRING = {"type": "string"}


def digits(value: Any) -> bool:
    return isinstance(value, str) and value.isascii() and value.isdigit() and int(value) < 2**63


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


# hypothesis wants bounds without a zone.
moments = st.datetimes(datetime(1970, 1, 1), datetime(2100, 1, 1))  # noqa: DTZ001


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


CUES = parse_type("list<struct<start_s: float64, duration_s: float64, text: string>>")
# What stands in recorded answers, and what a service might send one day.
number = st.floats(0, 1e5) | st.integers(-5, 10**6)
odd_number = st.sampled_from([-0.0, 2**53, 2**53 + 1, -(2**53) - 1, 2**64, 10**30, True, "1", None])
nan = st.sampled_from([float("nan"), float("inf")])  # json.loads takes them
words = st.text("ab \n♪é", max_size=9)
odd_words = st.sampled_from(["a\0b", "\ud800", "\\u0000", None, 3, ["a"]])
good_cue = st.tuples(number, number, words).map(list)
odd_cue = (
    st.tuples(number | odd_number | nan, number | odd_number, words | odd_words).map(list)
    | st.lists(number | words, max_size=4)
    | st.sampled_from(["abc", None, {"start": 1, "duration": 2, "text": "a"}, 7])
)
good_cues = st.none() | st.lists(good_cue, max_size=4)
odd_cues = st.lists(good_cue | odd_cue, max_size=4) | scalars | st.just({"a": 1})


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


transcript = st.fixed_dictionaries(
    {"video_id": st.just("a")},
    optional={
        "outcome": st.sampled_from(["ok", "none", 5, None]),
        "cues": good_cues | odd_cues,
        "kind": st.sampled_from(["asr", None]) | anything,
        "player": st.none()
        | anything
        | st.fixed_dictionaries(
            {}, optional={"width": st.integers(-1, 9) | anything, "fps": anything}
        ),
        "brand_new": anything,
    },
)


@settings(max_examples=150)
@given(st.lists(transcript, min_size=1, max_size=4))
def test_typed_and_patient_decoding_give_equal_tables(responses: list[Any]) -> None:
    reader = ColumnReader(table("youtube/transcripts"), "transcripts", note_absent=False)
    lines = [
        json.dumps(
            {
                "fetched_at": "2026-11-20T12:00:00Z",
                "request": {"params": {"video_id": "a"}},
                "status": 200,
                "response": response,
            },
            default=str,
        ).encode()
        for response in responses
    ]
    together = parse.with_cues(reader.table([reader.answer(line) for line in lines]))
    patient = parse.with_cues(reader.table([reader._patient(line) for line in lines]))
    assert repr(together.to_pylist()) == repr(patient.to_pylist())
    assert together.schema == patient.schema
    # And none of them changes another.
    apart = [parse.with_cues(reader.table([reader.answer(line)])).to_pylist()[0] for line in lines]
    assert repr(together.to_pylist()) == repr(apart)


@given(
    st.lists(anything | st.integers(0, 2**64)),
    st.sampled_from([["integer"], ["integer", "string", "null"]]),
)
def test_json_integers_are_counts_where_the_schema_says_so(values: list[Any], kinds: Any) -> None:
    column, bad = coerce.coerce(values, parse_type("int64"), {"type": kinds})

    def fits(value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, int):
            return "string" in kinds and digits(value)
        return 0 <= value < 2**63

    assert column.to_pylist() == [int(value) if fits(value) else None for value in values]
    assert [row for row, _ in bad] == [
        row for row, value in enumerate(values) if value is not None and not fits(value)
    ]
