"""Tests of `kb.schema.decode`."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData
from kb.schema import coerce, table
from kb.schema.decode import ColumnReader
from kb.schema.tables import parse_type
from tests.schema.json_values import (
    anything,
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
    together = reader.table([reader.answer(line) for line in lines]).to_pylist()
    apart = [reader.table([reader.answer(line)]).to_pylist()[0] for line in lines]
    assert repr(together) == repr(apart)


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
