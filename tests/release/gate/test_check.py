"""The gate: files, checksums, archives and licence; all lines come at once."""

import json
import re
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import NotReleasable, ReleaseRefused
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused, rewritten
from tests.release.made import build
from tests.release.signed import SIGNED

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
    profile.write_text(f'name = "mine"\ntitle = "Mine"\n[release]\n{SIGNED}')
    with pytest.raises(NotReleasable, match="names no licence of wiki"):
        release(a_run(tmp_path, profile=profile))


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
        f'name = "mine"\ntitle = "Mine"\n[release]\n{SIGNED}licenses = {{ wiki = "CC0-1.0" }}\n'
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
        ("pairs", "pairs/pairs-00000-of-00001.parquet"),
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


def test_lost_shard(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "release" / "youtube" / "videos-00001-of-00002.parquet").unlink()
    assert any(
        line.startswith("damaged: youtube/videos: shards are missing") for line in refused(tmp_path)
    )


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("reddit", "reddit.json"),
        ("reddit", "posts.csv"),
        ("reddit", "posts-1-of-1.parquet"),
        ("reddit", "sample-bodies.parquet"),
        ("reddit", "bodies.sample.json"),
        ("youtube", "LICENSE-mine.txt"),
        ("youtube", "images-00000-of-00001.tar"),
        ("youtube", "settings.env"),
        ("reddit", "sample-posts.parquet"),
        # What is kept of films: vectors, and pictures of clips.
        ("pairs", "ViT-B-16@0123456789ab.npz"),
        ("pairs", "film.npz"),
        ("pairs", "clips-00000.tar"),
        ("youtube", "vid00000000.jpg"),
        ("youtube", "film_figures-00000-of-00001.parquet"),
    ],
)
def test_undeclared_files(tmp_path: Path, source: str, name: str) -> None:
    build(tmp_path, sources=(source,))
    (tmp_path / "release" / source / name).write_text("text")
    assert refused(tmp_path) == [
        f"undeclared file: {source}/{name}: is not part of a release; remove it"
    ]


@pytest.mark.parametrize("source", ["pairs", "youtube"])
def test_vectors_and_pictures_of_films(tmp_path: Path, source: str) -> None:
    """A folder of them, and vectors in a column of a table that is declared."""
    build(tmp_path, sources=(source,))
    folder = tmp_path / "release" / source
    (folder / "vid00000000").mkdir()
    (folder / "vid00000000" / "film.npz").write_bytes(b"vectors")
    path = next(folder.glob("*-00000-of-*.parquet"))
    rows = pq.read_table(path)
    vectors = pa.array([[0.5] * 4] * rows.num_rows, pa.list_(pa.float16()))
    pq.write_table(rows.append_column("vector", vectors), path)
    lines = refused(tmp_path)
    assert f"layout: {source}/vid00000000: is a folder; a deposit is flat" in lines
    assert any("vector" in line for line in lines), lines


def test_links_are_not_followed(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "outside").write_text("not ours")
    for name in ("extra.txt", "README.md", "DATASHEET.md"):
        (tmp_path / "release" / "youtube" / name).symlink_to(
            tmp_path / ("nowhere" if name == "DATASHEET.md" else "outside")
        )
    assert refused(tmp_path) == [
        f"undeclared file: youtube/{name}: is a link; a release needs real files"
        for name in ("DATASHEET.md", "README.md", "extra.txt")
    ]


def test_archives_that_are_gone_or_cut_off(tmp_path: Path) -> None:
    build(tmp_path, sources=("wiki",))
    wiki = tmp_path / "release" / "wiki"
    images, screenshots = (
        wiki / "images-00000-of-00001.tar",
        wiki / "screenshots-00000-of-00001.tar",
    )
    whole = images.read_bytes()
    images.write_bytes(whole[:1024])
    (line,) = refused(tmp_path)
    assert re.fullmatch(
        r"damaged: wiki/images-00000-of-00001\.tar: is cut off:"
        r" \d+ of its files end beyond it; run `kb wiki export` again",
        line,
    )
    images.write_bytes(whole)
    release(a_run(tmp_path))
    screenshots.unlink()
    lines = refused(tmp_path)
    assert (
        f"checksum: wiki/{screenshots.name}: is in SHA256SUMS but missing; export it again" in lines
    )
    assert any(
        line.startswith(
            f"damaged: wiki/{screenshots.name}: is missing; index.ndjson names 12 files in it"
        )
        for line in lines
    )


@pytest.mark.parametrize("text", [None, "{", ""])
def test_index_that_is_gone_or_damaged(tmp_path: Path, text: str | None) -> None:
    build(tmp_path, sources=("wiki",))
    index = tmp_path / "release" / "wiki" / "index.ndjson"
    index.unlink() if text is None else index.write_text(text)
    lines = refused(tmp_path)
    assert lines
    assert all(
        line.startswith("damaged: wiki/") and line.endswith("run `kb wiki export` again")
        for line in lines
    )


@pytest.mark.parametrize("data", [b"\xff\xfe garbage", b"words\n"])
def test_damaged_checksums_are_a_line(tmp_path: Path, data: bytes) -> None:
    build(tmp_path, sources=("pairs",))
    (tmp_path / "release" / "pairs" / "SHA256SUMS").write_bytes(data)
    (line,) = refused(tmp_path)
    assert line.startswith("damaged: pairs/SHA256SUMS: can't be read")


def test_data_changed_after_the_release(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    release(a_run(tmp_path))
    shard = tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    rewritten(
        shard,
        lambda rows: rows.set_column(
            rows.column_names.index("keyword"), "keyword", pa.array(["x"] * rows.num_rows)
        ),
    )
    line = "checksum: pairs/pairs-00000-of-00001.parquet: differs from SHA256SUMS; export it again"
    assert line in refused(tmp_path)
