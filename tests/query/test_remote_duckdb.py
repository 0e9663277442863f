"""SQL over files at an address: how much is read of them, and what damage is reported."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

import kb
from kb.core.errors import DamagedData
from kb.query.remote_duckdb import RemoteFiles
from kb.store.tables.remote_files import remote_folders
from tests.store.tables.bucket import S3Server
from tests.store.tables.many_comments import ROWS, SHARDS, write_comments

PLACE = "memory://sql"


@pytest.fixture(scope="module")
def folder(make_rows, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("release") / "reddit"
    place.mkdir()
    return write_comments(place, make_rows)


@pytest.fixture(scope="module")
def bucket(folder: Path) -> Iterator[tuple[S3Server, str]]:
    with S3Server().running() as server:
        yield server, server.fill("lore", folder.parent)


@pytest.fixture
def memory(folder: Path) -> Iterator[fsspec.AbstractFileSystem]:
    system = fsspec.filesystem("memory")
    system.put(f"{folder}/", "/sql/reddit/", recursive=True)
    yield system
    system.rm("/sql", recursive=True)


@pytest.mark.parametrize(
    ("sql", "rows", "share"),
    [
        ("SELECT * FROM reddit_comments WHERE post_id = 'k0123456'", 1, 0.12),
        ("SELECT * FROM reddit_comments WHERE post_id IN ('k0000001', 'k0000002')", 2, 0.12),
        ("SELECT count(*) FROM reddit_comments", 1, 0.12),  # DuckDB guesses how long a footer is
        ("SELECT * FROM reddit_comments LIMIT 5", 5, 0.5),  # some row groups for each thread
    ],
)
def test_a_query_reads_what_it_needs(
    bucket: tuple[S3Server, str], folder: Path, sql: str, rows: int, share: float
) -> None:
    server, address = bucket
    size = sum(path.stat().st_size for path in folder.iterdir())
    before = server.answered
    data = kb.load(address, storage_options=server.options())
    assert len(data.sql(sql)) == rows
    assert 0 < server.answered - before <= size * share


def test_the_first_rows_are_read_with_the_footers_of_the_others(
    bucket: tuple[S3Server, str], folder: Path
) -> None:
    server, address = bucket
    data = kb.load(address, storage_options=server.options())
    before = server.answered
    assert data["reddit_comments"].head().num_rows == 5
    assert server.answered - before <= sum(path.stat().st_size for path in folder.iterdir()) / 12


def test_every_row_arrives(memory: fsspec.AbstractFileSystem, folder: Path) -> None:
    """In the order of the files, whatever the ranges that DuckDB asks for."""
    here, there = kb.load(folder), kb.load(PLACE)
    for sql in ("FROM reddit_comments", "SELECT min(score), max(comment_id) FROM reddit_comments"):
        assert there.sql(sql).to_table().equals(here.sql(sql).to_table())
    assert len(there.sql("FROM reddit_comments")) == ROWS


def test_a_file_that_ends_early_is_damaged(memory: fsspec.AbstractFileSystem) -> None:
    opened = kb.load(PLACE)
    path = f"/sql/reddit/{SHARDS[0]}"
    memory.pipe(path, memory.cat(path)[:-1000])
    with pytest.raises(DamagedData, match=f"{PLACE}/reddit/{SHARDS[0]} can't be read"):
        opened.sql("FROM reddit_comments LIMIT 1")


def test_tombstones_are_verified(demo: Path, tmp_path: Path) -> None:
    place = tmp_path / "youtube"
    shutil.copytree(demo / "data/demo/release/youtube", place)
    (place / "tombstones.ndjson").write_bytes(b"{}\n")
    with pytest.raises(DamagedData, match=r"tombstones\.ndjson can't be read: checksum mismatch"):
        kb.load(f"file://{place}").sql("FROM youtube_tombstones")


def test_only_files_of_the_tables_can_be_read(memory: fsspec.AbstractFileSystem) -> None:
    system = RemoteFiles()
    (there,) = remote_folders(f"{PLACE}/reddit")
    address = system.add_file(there, SHARDS[0])
    assert (system.glob(address), system.glob("address://0/profile.toml")) == ([address], [])
