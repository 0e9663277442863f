"""The gate: one wrong value at a time, and its line. All lines come at once."""

import json
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import ReleaseRefused
from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused
from tests.release.made import build

Rows = list[dict[str, Any]]


def test_nothing_exported(tmp_path: Path) -> None:
    with pytest.raises(ReleaseRefused, match="nothing to release"):
        release(a_run(tmp_path))


def test_wiki_without_licence(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed("wiki/pages", lambda row: row.update(license=None), slice(None)),
        ("wiki",),
    )
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\n')
    assert refused(tmp_path, profile=profile) == [
        "licence: wiki/LICENSE: none is given; set wiki in [release.licenses] of the profile"
    ]


def test_wiki_under_a_licence_that_no_release_can_carry(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed(
            "wiki/pages",
            lambda row: row.update(license="https://wiki.example.org/terms"),
            slice(None),
        ),
        ("wiki",),
    )
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[release.licenses]\nwiki = "CC-BY-NC-SA-3.0"\n'
    )
    (line,) = refused(tmp_path, profile=profile)
    assert line.startswith(
        "licence: wiki/LICENSE: the pages name https://wiki.example.org/terms,"
        " which is not a licence that a release can use"
    )


def test_some_pages_without_licence(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed("wiki/pages", lambda row: row.update(license=None), slice(0, 2)),
        ("wiki",),
    )
    assert refused(tmp_path) == [
        "licence: wiki/pages: 2 rows name no licence, though others do; run `kb wiki crawl --again`"
    ]


def test_a_wiki_without_a_recipe_is_released_again(tmp_path: Path) -> None:
    """An empty table, whose sample lies there the second time, holds no wrong word."""

    def edit(table: str, made: Rows) -> None:
        if table == "wiki/recipes":
            made.clear()

    build(tmp_path, edit, sources=("wiki",))
    for _ in range(2):
        release(a_run(tmp_path))
        sample = tmp_path / "release" / "wiki" / "recipes.sample.json"
        assert json.loads(sample.read_bytes()) == []


@pytest.mark.parametrize(
    ("text", "file"),
    [
        ("youtube", "clean/youtube/videos/part-00000.parquet"),
        ("pairs", "pairs/part-00000.parquet"),
        ("pairs", "release/pairs/pairs.sample.json"),
    ],
)
def test_damaged_files_are_lines(tmp_path: Path, text: str, file: str) -> None:
    build(tmp_path, sources=(text,))
    release(a_run(tmp_path))
    path = tmp_path / file
    path.write_bytes(path.read_bytes()[:500])
    lines = refused(tmp_path)
    assert any(
        line.startswith(f"damaged: {file.removeprefix('release/')}: can't be read")
        and "again" in line
        for line in lines
    )
