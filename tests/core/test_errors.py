"""Tests of `kb.core.errors`."""

import re
from datetime import UTC, datetime

import pytest

from kb.core import errors
from kb.core.errors import KbError

TREE = [line for line in (errors.__doc__ or "").splitlines() if "─ " in line]


@pytest.mark.parametrize("line", TREE, ids=lambda line: line.split()[-1])
def test_the_tree_of_the_docstring_is_the_classes(line: str) -> None:
    name = re.search(r"─ (\w+)", line)[1]
    kind = getattr(errors, name)
    assert issubclass(kind, KbError)
    if match := re.search(r"  (\d)  ", line):
        assert kind.exit_code == int(match[1])


def test_every_class_is_in_the_tree() -> None:
    named = {re.search(r"─ (\w+)", line)[1] for line in TREE}
    classes = {one.__name__ for one in vars(errors).values() if isinstance(one, type)}
    assert {name for name in classes if issubclass(getattr(errors, name, int), KbError)} == {
        *named,
        "KbError",
    }


def test_what_an_error_carries() -> None:
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    assert errors.QuotaSpent("spent", reset_at=moment).reset_at == moment
    assert str(errors.ItemFinal("not_found", "404")) == "not_found: 404"
    assert errors.Retryable("slow", after=3.0, throttled=True).throttled
    assert errors.FatalError("no", hint="do").hint == "do"
