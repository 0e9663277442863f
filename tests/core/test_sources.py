"""The sources: what each says of itself agrees with the schemas and with its parts."""

import pytest

from kb.core.sources import BY_DEFAULT, PUBLISHED, SOURCES, exported_by, made_by, made_of
from kb.schema.tables import tables
from kb.youtube.source import YouTube


@pytest.mark.parametrize("name", SOURCES)
def test_tables_of_a_source_are_declared(name: str) -> None:
    source = SOURCES[name]
    shorts = [*source.tables, *source.indexed, *source.linked]
    assert {f"{name}/{short}" for short in shorts} <= set(tables())
    assert {*source.shown, *source.sampled} <= set(tables())
    assert source.main in source.tables


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_exported_has_a_writer(name: str) -> None:
    assert {*PUBLISHED[name].formats} == {*PUBLISHED[name].writers()} - {"parquet"}


@pytest.mark.parametrize("name", SOURCES)
def test_the_rules_of_a_purge_are_those_of_the_source(name: str) -> None:
    assert SOURCES[name].purge_rules().source == name


def test_what_is_made_from_sources() -> None:
    assert made_of("pairs") == ("youtube",)
    assert made_of("links") == tuple(SOURCES)
    assert made_of("tasks") == made_of("pairs")
    assert made_of("wiki") == ("wiki",)
    assert (*SOURCES, "pairs", "tasks", "links") == BY_DEFAULT
    assert (*BY_DEFAULT, "open-text") == tuple(PUBLISHED)
    assert (made_by("wiki"), exported_by("wiki")) == ("kb wiki filter", "kb wiki export")
    assert (made_by("pairs"), exported_by("links")) == ("kb pairs", "kb links")
    youtube = ("kb youtube filter", "kb youtube export")
    assert (made_by("open-text"), exported_by("open-text")) == youtube


def test_what_is_left_in_the_order_of_work() -> None:
    """Kinds that are never fetched are left out, and new ones come last."""
    left = {"videos": {"todo": 2, "in_progress": 1, "done": 9}, "searches": {"todo": 0}}
    kinds = {**left, "channels": {"todo": 5}, "strange_kind": {}}
    assert YouTube.in_order(kinds) == ["searches", "videos", "strange_kind"]
    assert YouTube.left_by(kinds) == {"videos": 3}
    assert YouTube.noun("strange_kind") == "strange kind"
