"""What a folder holds: a data root, a restored one, a download, or nothing."""

from pathlib import Path
from typing import Any

import pytest

from kb.artifacts import release_folder, table_catalog
from kb.artifacts.table_catalog import Catalog
from kb.core.errors import DamagedData, FatalError, SettingError, UsageError
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table
from tests.filters import full_root

SHARD = "-00000-of-00001.parquet"


def release(folder: Path, make_rows: Any, name: str) -> Path:
    short = name.partition("/")[2]
    rows = make_rows(name, 3, released=True)
    write_table(folder / f"{short}{SHARD}", rows, name, released=True)
    return folder


def test_texts_are_read_where_they_are_fullest(tmp_path: Path, make_rows: Any) -> None:
    release(tmp_path / "release" / "youtube", make_rows, "youtube/videos")
    release(tmp_path / "release" / "reddit", make_rows, "reddit/posts")
    held = table_catalog.read_catalog(tmp_path)
    assert held.is_download
    assert held.workplace != tmp_path
    assert held.schema_of("youtube") == "release"
    assert held.files("reddit/posts")
    assert not held.texts("reddit/posts")  # a release has none of them
    rows = make_rows("reddit/posts", 2)
    write_table(tmp_path / "restored/reddit/posts/part-00000.parquet", rows, "reddit/posts")
    write_table(
        tmp_path / "restored/reddit/missing.parquet",
        make_rows("reddit/missing", 1),
        "reddit/missing",
    )
    held = table_catalog.read_catalog(tmp_path)
    assert (held.is_download, held.workplace) == (False, tmp_path)
    assert held.schema_of("reddit") == "restored"
    assert held.texts("reddit/posts")[0].parent.parent.parent.name == "restored"
    write_table(tmp_path / "clean/reddit/posts/part-00000.parquet", rows, "reddit/posts")
    assert table_catalog.read_catalog(tmp_path).schema_of("reddit") == "clean"


def test_links_have_the_same_names_everywhere(tmp_path: Path, make_rows: Any) -> None:
    for folder in (tmp_path / "links", tmp_path / "whole" / "release" / "links"):
        release(folder, make_rows, "links/entities")
        release(folder, make_rows, "links/links")
    for place in (tmp_path / "links", tmp_path / "whole"):
        names = {view.full for view in table_catalog.read_catalog(place).views}
        assert {"links.entities", "links.links", "release.entities", "release.links"} <= names


def test_a_folder_that_is_not_there_is_told_with_the_nearest(
    tmp_path: Path, make_rows: Any
) -> None:
    root = tmp_path / "data" / "demo" / "demo"
    release(root / "release" / "youtube", make_rows, "youtube/videos")
    (root / "state").mkdir()
    for given in ("data/demo", "data", "data/demo/dmeo"):
        with pytest.raises(SettingError) as caught:
            table_catalog.read_catalog(tmp_path / given)
        assert caught.value.exit_code == 2
        assert "did you mean --data" in caught.value.hint
        assert "data/demo/demo" in caught.value.hint
    (tmp_path / "empty").mkdir()
    with pytest.raises(FatalError) as told:
        table_catalog.read_catalog(tmp_path / "empty")
    assert (told.value.exit_code, "kb demo" in told.value.hint) == (1, True)


def test_two_releases_of_one_source_are_told_apart(tmp_path: Path, make_rows: Any) -> None:
    for name in ("first", "second"):
        release(tmp_path / name, make_rows, "youtube/videos")
    with pytest.raises(UsageError, match=r"release\.youtube_videos is in .*first and in .*second"):
        table_catalog.read_catalog(tmp_path)


def test_a_table_without_any_of_its_files_is_damage(tmp_path: Path) -> None:
    full_root.make(tmp_path / "data")
    lost = Layout(tmp_path / "data").rows("youtube/transcripts")
    for path in lost:
        path.unlink()
    with pytest.raises(DamagedData, match="is missing"):
        Catalog(tmp_path / "data").texts("youtube/transcripts")


def test_checksums_are_read_and_invalid_lines_are_counted(tmp_path: Path) -> None:
    assert release_folder.sums(tmp_path) == ({}, 0)
    digest = "0" * 64
    (tmp_path / "SHA256SUMS").write_text(f"{digest}  videos.parquet\nnot a checksum\n")
    assert release_folder.sums(tmp_path) == ({"videos.parquet": digest}, 1)
    (tmp_path / "SHA256SUMS").write_bytes(b"\xff\xfe")
    assert release_folder.sums(tmp_path) == ({}, 1)
