"""The registry: every name of code in a spec is there, and every spec agrees with the schemas."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from kb.core.source_spec import SourceSpec
from kb.core.sources import BY_DEFAULT, PUBLISHED, SOURCES, SPECS, exported_by, made_by, made_of
from kb.schema.tables import tables


def named_code(value: Any) -> Iterator[str]:
    """All names of modules and attributes in a spec."""
    if is_dataclass(value):
        for field in fields(value):
            yield from named_code(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield from (name for each in value.values() for name in named_code(each))
    elif isinstance(value, tuple):
        yield from (name for each in value for name in named_code(each))
    elif isinstance(value, str) and (value.startswith("kb.") or ":" in value.partition(" ")[0]):
        yield value


@pytest.mark.parametrize("name", SOURCES)
def test_everything_that_a_spec_names_is_there(name: str) -> None:
    spec = SPECS[name]
    refs = [spec.agent.ref] if spec.agent else []
    code = [each for each in named_code(spec) if each not in refs and "://" not in each]
    assert len(code) > 5
    for each in code:
        spec.load(each)


@pytest.mark.parametrize("name", SOURCES)
def test_tables_of_a_spec_are_declared(name: str) -> None:
    spec = SPECS[name]
    shorts = [*spec.tables, *spec.indexed, *spec.restored, *(one.table for one in spec.texts)]
    assert {f"{name}/{short}" for short in shorts} <= set(tables())
    assert {*spec.report.tables, *spec.report.samples} <= set(tables())
    assert spec.release.main in spec.tables


def test_what_is_made_from_sources() -> None:
    assert made_of("pairs") == ("youtube",)
    assert made_of("links") == SOURCES
    assert made_of("tasks") == made_of("pairs")
    assert made_of("wiki") == ("wiki",)
    assert (*SOURCES, "pairs", "tasks", "links") == BY_DEFAULT
    assert (*BY_DEFAULT, "open-text") == PUBLISHED
    assert (made_by("wiki"), exported_by("wiki")) == ("kb wiki filter", "kb wiki export")
    assert (made_by("pairs"), exported_by("links")) == ("kb pairs", "kb links")
    youtube = ("kb youtube filter", "kb youtube export")
    assert (made_by("open-text"), exported_by("open-text")) == youtube


def test_what_is_left_in_the_order_of_work() -> None:
    spec: SourceSpec = SPECS["youtube"]
    kinds = {"videos": {"todo": 2, "in_progress": 1}, "searches": {"todo": 0}, "channels": {}}
    assert spec.in_order({**kinds, "strange_kind": {}}) == ["searches", "videos", "strange_kind"]
    assert spec.left_by(kinds) == {"videos": 3}
    assert spec.noun("strange_kind") == "strange kind"
