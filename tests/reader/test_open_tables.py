"""Missing files and folders are errors, and never fewer rows."""

import gc
import shutil
from pathlib import Path

import duckdb
import pytest

import kb
from kb.core.errors import DamagedData, FatalError, UsageError
from kb.reader.open_tables import OpenTables


def test_a_missing_shard_is_named_and_never_less_rows(folder: Path) -> None:
    assert len(kb.load(folder)["reddit_posts"]) == 12
    (folder / "posts-00001-of-00003.parquet").unlink()
    for place in (folder, folder.parent):
        with pytest.raises(DamagedData, match=r"posts-00001-of-00003\.parquet is missing"):
            kb.load(place)
    root = folder.parent / "root"
    shutil.copytree(folder, root / "release" / "reddit")
    with pytest.raises(DamagedData, match=r"posts-00001-of-00003\.parquet is missing"):
        kb.load(root)


def test_a_missing_table_is_told_by_the_checksums(folder: Path) -> None:
    names = sorted(path.name for path in folder.iterdir())
    (folder / "SHA256SUMS").write_text("".join(f"{'0' * 64}  {name}\n" for name in names))
    assert len(kb.load(folder)["reddit_comments"]) == 5
    (folder / "comments-00000-of-00001.parquet").unlink()
    with pytest.raises(DamagedData, match=r"comments-00000-of-00001\.parquet is missing"):
        kb.load(folder)
    for path in folder.glob("*.parquet"):
        path.unlink()
    with pytest.raises(DamagedData, match="is missing"):
        kb.load(folder.parent)


def test_a_folder_of_no_tables_and_no_folder(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FatalError, match=r"no tables in .*, and it is not a release"):
        kb.load(tmp_path / "empty")
    shutil.copytree(folder, tmp_path / "empty" / "demo" / "release" / "reddit")
    with pytest.raises(UsageError, match="is not a data root or a release") as caught:
        kb.load(tmp_path / "empty")
    assert str(tmp_path / "empty" / "demo") in caught.value.hint
    with pytest.raises(UsageError, match="there is no "):
        kb.load(tmp_path / "nowhere")
    with pytest.raises(UsageError, match="is not a folder"):
        kb.load(folder / "posts-00000-of-00003.parquet")


def test_its_connection_is_closed_with_it() -> None:
    """Threads of an open one would call Python, to read at an address, while Python exits."""
    opened = OpenTables([])
    con = opened.con
    assert con.execute("SELECT 1").fetchall() == [(1,)]
    del opened
    gc.collect()
    with pytest.raises(duckdb.ConnectionException):
        con.execute("SELECT 1")
