"""Tests of `kb.schema.decode`."""

import json
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData, SchemaMismatch
from kb.schema import coerce, raw, table
from kb.schema.decode import ColumnReader, rows_of
from kb.schema.tables import parse_type, tables
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
    st.lists(anything | st.integers(-(2**64), 2**64)),
    st.sampled_from([["integer"], ["integer", "string", "null"]]),
    st.sampled_from([{}, {"minimum": 0}]),
)
def test_json_integers_are_what_the_schema_says(
    values: list[Any], kinds: Any, least: dict[str, int]
) -> None:
    column, bad = coerce.coerce(values, parse_type("int64"), {"type": kinds, **least})

    def fits(value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, int):
            return "string" in kinds and digits(value)
        return least.get("minimum", -(2**63) + 1) <= value < 2**63

    assert column.to_pylist() == [int(value) if fits(value) else None for value in values]
    assert [row for row, _ in bad] == [
        row for row, value in enumerate(values) if value is not None and not fits(value)
    ]


def of_kind(folder: Path, columns: str) -> None:
    """A source `other` with one table of the raw kind `lists`, in a package's schemas."""
    (folder / "tables/other").mkdir(parents=True)
    (folder / "raw/other").mkdir(parents=True)
    head = 'name = "other/things"\ndoc = "Things."\nkey = ["id"]\nsort_by = ["id"]\n'
    (folder / "tables/other/things.toml").write_text(f"{head}column = [{columns}]\n")
    types = {"id": "integer", "at": "integer", "n": "integer", "x": "object"}
    entry = {"properties": {name: {"type": kind} for name, kind in types.items()}}
    data = {"properties": {"rows": {"type": "array", "items": entry}}}
    (folder / "raw/other/lists.json").write_text(json.dumps({"properties": {"data": data}}))


def column(name: str, type_: str, at: str = "") -> str:
    where = f'from = "lists: {at or f"data.rows[].{name}"}"'
    return f'{{ name = "{name}", type = "{type_}", doc = "d", null = "n", {where} }}'


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of schemas of an installed package."""
    for cached in (raw.raw, tables):
        cached.cache_clear()
    for module in ("raw", "tables"):
        monkeypatch.setattr(sys.modules[f"kb.schema.{module}"], "SCHEMA_FOLDERS", [tmp_path])
    yield tmp_path
    for cached in (raw.raw, tables):
        cached.cache_clear()


@pytest.mark.parametrize("odd", [False, True])
def test_lists_ids_times_and_parameters_of_any_service(package: Path, odd: bool) -> None:
    columns = [column("id", "string"), column("at", "timestamp[us, UTC]"), column("n", "int64")]
    of_kind(package, ", ".join(columns))
    reader = ColumnReader(table("other/things"), "lists", asked=("user",))
    rows: list[Any] = [{"id": 11, "at": 1_700_000_000, "n": -3}, *([{"id": "x11"}] if odd else [])]
    line = {
        "fetched_at": "2026-01-01T00:00:00Z",
        "status": 200,
        "request": {"endpoint": "e", "params": {"user": "someone", "page": "2"}},
        "response": {"data": {"rows": rows}},
    }
    ((made, answers),) = reader.tables([json.dumps(line).encode()])
    assert made["id"].to_pylist() == ["11", *(["x11"] if odd else [])]
    assert made["at"][0].as_py() == datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)
    assert made["n"][0].as_py() == -3
    assert answers[0].params == {"user": "someone"}


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (column("n", "bool"), "column n: a bool is not read from JSON's integer"),
        (column("x", "list<string>"), "column x: a list<string> is not read from JSON's object"),
        (column("at", "date"), "column at: a date is not read from JSON"),
        (column("y", "string"), r"column y: schemas/raw/other/lists.json has no data.rows\[\].y"),
        (column("z", "string", "data.total"), "column z: .* has no data.total"),
    ],
)
def test_what_is_not_read_is_refused_at_once(package: Path, wrong: str, problem: str) -> None:
    of_kind(package, f"{column('id', 'string')}, {wrong}")
    with pytest.raises(SchemaMismatch, match=rf"schemas/tables/other/things.toml: {problem}"):
        ColumnReader(table("other/things"), "lists")
