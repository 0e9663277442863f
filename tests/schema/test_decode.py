"""Tests of `kb.schema.decode`."""

import json
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData
from kb.schema import coerce, table
from kb.schema.decode import ColumnReader, rows_of
from kb.schema.tables import parse_type
from tests.schema.json_values import (
    anything,
    digit_texts,
    digits,
    transcript,
)


@settings(max_examples=150)
@given(st.lists(transcript, min_size=1, max_size=4))
def test_no_answer_changes_another(responses: list[Any]) -> None:
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
    together = pa.concat_tables(rows for rows, _ in reader.tables(lines))
    together.validate(full=True)
    apart = [reader.table([reader.answer(line)]).to_pylist()[0] for line in lines]
    assert repr(together.to_pylist()) == repr(apart)


odd = digit_texts | anything
item = st.fixed_dictionaries(
    {"id": st.sampled_from(["a", "b"])},
    optional={
        "snippet": st.fixed_dictionaries(
            {},
            optional={
                "title": st.text(max_size=4) | odd,
                "tags": st.lists(st.text(max_size=3), max_size=3) | odd,
                "publishedAt": st.just("2026-01-01T00:00:00Z") | odd,
            },
        )
        | odd,
        "statistics": st.fixed_dictionaries({}, optional={"viewCount": odd, "likeCount": odd}),
        "contentDetails": st.fixed_dictionaries(
            {}, optional={"duration": st.just("PT1M"), "caption": st.sampled_from(["true", "?"])}
        ),
        "status": st.fixed_dictionaries({}, optional={"madeForKids": st.booleans() | odd}),
    },
)


@settings(max_examples=150)
@given(st.lists(st.tuples(st.lists(item, max_size=3), st.sampled_from([200, 403])), max_size=4))
def test_answers_read_at_once_are_those_read_one_by_one(answers: list[Any]) -> None:
    reader = ColumnReader(table("youtube/videos"), "videos")
    lines = [
        json.dumps(
            {
                "fetched_at": "2026-11-20T12:00:00Z",
                "request": {"params": {"id": "a,b"}},
                "status": status,
                "response": {"items": items},
            },
        ).encode()
        for items, status in answers
    ]
    decoded = [one for line in lines if (one := reader.answer(line)).status == 200]
    for rows, found in reader.tables(lines):
        rows.validate(full=True)
        assert rows.equals(reader.table(decoded))
        assert found == rows_of(decoded)


@pytest.mark.parametrize("line", [b"{", b"[]", b"null", b'{"request": 3}', b'{"text": "\xff"}'])
def test_a_line_that_is_no_envelope_is_damage(line: bytes) -> None:
    reader = ColumnReader(table("youtube/transcripts"), "transcripts")
    with pytest.raises(DamagedData, match="not an envelope"):
        reader.answer(line)


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
