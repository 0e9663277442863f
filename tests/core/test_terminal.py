"""Text of others is shown, never obeyed: in log lines, errors, summaries and progress."""

import io
import json
import re
import sys
import unicodedata
from collections.abc import Callable
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.cli.framework.progress_bars import Bars
from kb.core import terminal
from kb.query.formats import write_answer

HOSTILE = "a\x1b]0;t\x07\x9b31m\u202eb\r\nkb: all is well\u2028c\ud800"


def test_one_line_writes_out_what_acts() -> None:
    shown = r"a\x1b]0;t\x07\x9b31m\u202eb\r\nkb: all is well\u2028c\ud800"
    assert terminal.one_line(HOSTILE) == shown
    assert terminal.one_line("Ünï 日本 👩‍🚀 עברית") == "Ünï 日本 👩‍🚀 עברית"
    assert terminal.lines("one\n\ttwo\x1b") == "one\n\ttwo\\x1b"


@given(st.text(st.characters()), st.sampled_from([terminal.one_line, terminal.lines]))
def test_no_text_acts(text: str, written: Callable[[str], str]) -> None:
    """Of what is left a terminal obeys nothing, and all else stands there as it was."""
    shown = written(text)
    kept = "\n\t" if written is terminal.lines else ""
    assert not [one for one in shown if acts(one) and one not in kept]
    assert [one for one in text if not acts(one)] == [
        one
        for one in re.sub(r"\\x[0-9a-f]{2}|\\u[0-9a-f]{4}|\\[nrt]", "", shown)
        if one not in kept
    ] or "\\" in text
    assert written(shown) == shown
    if written is terminal.one_line:
        assert len(shown.splitlines()) <= 1
    shown.encode()  # every stream can take it


@settings(max_examples=50)
@given(st.dictionaries(st.text(), st.text() | st.integers() | st.none(), max_size=3))
def test_json_keeps_its_values(value: Any) -> None:
    shown = terminal.json(json.dumps(value, ensure_ascii=False))
    assert json.loads(shown) == value
    assert not [one for one in shown if acts(one)]
    assert len(shown.splitlines()) == 1


def acts(one: str) -> bool:
    """Controls of both kinds, marks of direction, breaks of lines, halves of characters."""
    kind = unicodedata.category(one)
    return kind in ("Cc", "Cs", "Zl", "Zp") or unicodedata.bidirectional(one) in (
        "LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"
    ) or one in "\u200e\u200f\u061c"  # fmt: skip


def test_a_progress_line_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    Bars().say(HOSTILE)
    assert stream.getvalue() == terminal.one_line(HOSTILE) + "\n"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


TEXT = HOSTILE.replace("\ud800", "")  # what a table can hold


@pytest.mark.parametrize("format", ["table", "csv", "json", "ndjson"])
def test_an_answer_on_a_terminal_and_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    def printed(stream: io.StringIO) -> str:
        monkeypatch.setattr(sys, "stdout", stream)
        write_answer(pa.table({TEXT: [TEXT]}).to_reader(), format, None)
        return stream.getvalue()

    shown, piped = printed(Terminal()), printed(io.StringIO())
    assert not [one for one in shown if acts(one) and one != "\n"]
    assert "all is well" in shown
    if "json" in format:
        value = {TEXT: TEXT}
        assert json.loads(shown) == json.loads(piped) == (value if format == "ndjson" else [value])
    if format == "csv":
        assert TEXT in piped  # exactly
    if format == "table":
        assert not [one for one in piped if acts(one) and one != "\n"]


def test_a_table_has_its_first_column_to_the_left() -> None:
    rows = [("kind", "files", "bytes"), ("state", "1", "20")]
    assert terminal.table(rows) == ["kind   files  bytes", "state      1     20"]
    assert terminal.table(rows, 7) == ["kind     files    bytes", "state        1       20"]
