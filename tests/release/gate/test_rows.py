"""Released rows are the clean ones, scored and fresh."""

import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from kb.artifacts.purge import note_keys
from kb.core.errors import DamagedData
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.gate.refusals import changed, refused, rewritten, with_first
from tests.release.made import build
from tests.release.signed import LINES

Rows = list[dict[str, Any]]


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [
        ("youtube/videos", "toxicity_title", "title"),
        ("youtube/videos", "toxicity_description", "description"),
        ("reddit/posts", "toxicity_body", "body"),
        ("reddit/comments", "toxicity_body", "body"),
        ("wiki/pages", "toxicity", "the page's text"),
    ],
)
def test_text_without_score(tmp_path: Path, table: str, column: str, text: str) -> None:
    build(
        tmp_path,
        changed(table, lambda row: row.update({column: None}), slice(0, 3)),
        (table.partition("/")[0],),
    )
    source = table.partition("/")[0]
    again = f"run `kb {source} filter` and `kb {source} export` again"
    assert refused(tmp_path) == [
        f"toxicity: {table}: 3 rows have no toxicity score of {text}; {again}"
    ]


def test_empty_text_needs_no_score(tmp_path: Path) -> None:
    build(
        tmp_path,
        changed(
            "youtube/videos", lambda row: row.update(description="", toxicity_description=None)
        ),
        ("youtube",),
    )
    assert release(a_run(tmp_path))["folders"] == 1


def test_rows_that_an_unfinished_purge_was_to_remove(tmp_path: Path) -> None:
    """What was asked to be removed must not be published meanwhile."""
    build(tmp_path, sources=("youtube", "pairs", "wiki"))
    note_keys(tmp_path, "youtube", {"vid00000003": "named"})
    what = "a purge of youtube has not finished; run `kb purge youtube` again"
    assert refused(tmp_path) == [f"removed: youtube: {what}", f"removed: pairs: {what}"]


def test_rows_that_differ_from_clean(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    rewritten(
        tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet", lambda rows: rows.slice(1)
    )
    assert refused(tmp_path) == ["rows: pairs/pairs: 119 released, 120 clean; run the export again"]


def test_table_that_was_never_exported(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",))
    (tmp_path / "release" / "reddit" / "comments-00000-of-00001.parquet").unlink()
    assert refused(tmp_path) == [
        "rows: reddit/comments: is clean but not exported; run the export again"
    ]


@pytest.mark.parametrize(
    ("table", "column", "text"),
    [("youtube/videos", "toxicity_title", "title"), ("wiki/pages", "toxicity", "the page's text")],
)
def test_released_text_without_score(tmp_path: Path, table: str, column: str, text: str) -> None:
    source, _, short = table.partition("/")
    build(tmp_path, sources=(source,))
    shard = next((tmp_path / "release" / source).glob(f"{short}-00000-*"))
    rewritten(shard, lambda rows: with_first(rows, column, None))
    shutil.rmtree(tmp_path / "state" / "manifests", ignore_errors=True)  # digests of the export
    (shard.parent / "SHA256SUMS").unlink(missing_ok=True)
    assert refused(tmp_path) == [
        f"toxicity: {table}: 1 released rows have no toxicity score of {text}; run the export again"
    ]


def test_rows_too_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build(tmp_path, sources=("youtube",))
    monkeypatch.setenv("KB_NOW", "2026-12-02T00:00:00Z")
    lines = refused(tmp_path)
    assert lines == [
        (
            "age: youtube/videos: 24 rows were read more than 30 days ago (the oldest on"
            " 2026-11-01); run `kb refresh youtube`"
        )
    ]


@pytest.mark.parametrize(
    ("table", "column", "own"),
    [("youtube/videos", "metadata_origin", "file"), ("reddit/posts", "score_source", "dump")],
)
def test_rows_of_own_files_and_dumps_have_no_age(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: str, column: str, own: str
) -> None:
    source = table.partition("/")[0]
    columns = {column: own, "fetched_at": datetime(2020, 1, 1, tzinfo=UTC)}

    def edit(name: str, made: Rows) -> None:
        for row in made if name.startswith(f"{source}/") else []:
            row.update({name: value for name, value in columns.items() if name in row})

    build(tmp_path / "own", edit, (source,))
    release(a_run(tmp_path / "own"))
    columns[column] = {"file": "api", "dump": "live"}[own]
    build(tmp_path / "served", edit, (source,))
    assert any(line.startswith(f"age: {table}: ") for line in refused(tmp_path / "served"))


def test_a_release_without_scores_says_so(tmp_path: Path) -> None:
    def edit(name: str, made: Rows) -> None:
        for row in made if name == "youtube/videos" else []:
            row.update({"toxicity_title": None, "toxicity_description": None})

    build(tmp_path, edit, ("youtube", "pairs"))
    profile = tmp_path / "mine.toml"
    profile.write_text('name = "mine"\ntitle = "Mine"\ntoxicity = "off"\n[release]\n' + LINES)
    release(a_run(tmp_path, profile=profile))
    for source in ("youtube", "pairs"):
        folder = tmp_path / "release" / source
        screen = (folder / "README.md").read_text().partition("|  |  |")[0]
        assert "Toxicity: not scored" in screen
        for name in ("DATASHEET.md", "croissant.json", "zenodo.json"):
            text = (folder / name).read_text()
            assert "Toxicity: not scored" in text
            assert "passed the toxicity stage" not in text
            assert "Detoxify" not in text


def test_damaged_scores_are_a_line(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    (tmp_path / "annotations" / "youtube").mkdir(parents=True)
    (tmp_path / "annotations" / "youtube" / "part.parquet").write_bytes(b"PAR1 cut off")
    with pytest.raises(DamagedData, match=r"part\.parquet"):
        release(a_run(tmp_path))
