"""Tests of hints in tracebacks."""

import pytest

from kb.core.errors import UsageError
from kb.reader.error_hints import with_hints


def test_a_hint_becomes_a_note_once() -> None:
    @with_hints
    def inner() -> None:
        raise UsageError("no such table", hint="see data.tables")

    with pytest.raises(UsageError) as caught:
        with_hints(inner)()
    assert caught.value.__notes__ == ["see data.tables"]


def test_other_errors_and_results_are_unchanged() -> None:
    assert with_hints(len)([1, 2]) == 2
    with pytest.raises(TypeError) as caught:
        with_hints(len)(3)
    assert not hasattr(caught.value, "__notes__")
