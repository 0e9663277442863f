"""The command's fixture, for tests of what it prints."""

import subprocess
from pathlib import Path

import pytest

from kb import query
from kb.store.state import tombstones
from kb.store.tables.shard_writer import write_table
from tests import inprocess
from tests.cli.conftest import Kb, clean_environment


@pytest.fixture
def kb(tmp_path: Path) -> Kb:
    """kb("query", …): the command in an empty folder, and in this process."""

    def run(*words: str) -> "subprocess.CompletedProcess[str]":
        done = inprocess.run(words, env=clean_environment(), cwd=tmp_path)
        return subprocess.CompletedProcess(words, *done)

    return run


@pytest.fixture
def root(tmp_path: Path, make_rows) -> Path:
    root = tmp_path / "it's [a] *root*"
    write_table(
        root / "clean/youtube/videos/part-00000.parquet",
        make_rows("youtube/videos", 4),
        "youtube/videos",
    )
    write_table(
        root / "clean/youtube/videos/part-00001.parquet",
        make_rows("youtube/videos", 3),
        "youtube/videos",
    )
    write_table(
        root / "clean/youtube/rejected/part-00000.parquet",
        make_rows("shared/rejected", 2),
        "shared/rejected",
    )
    write_table(
        root / "release/youtube/videos-00000-of-00001.parquet",
        make_rows("youtube/videos", 5, released=True),
        "youtube/videos",
        released=True,
    )
    write_table(
        root / "release/reddit/posts-00000-of-00001.parquet",
        make_rows("reddit/posts", 6, released=True),
        "reddit/posts",
        released=True,
    )
    write_table(
        root / "pairs/pairs-00000-of-00001.parquet", make_rows("pairs/pairs", 1), "pairs/pairs"
    )
    tombstones.add_tombstones(root, "youtube", [("gone", "named")])
    return root


def rows(root: Path, sql: str) -> list[tuple[object, ...]]:
    with query.connect(root) as con:
        return [
            tuple(row.values()) for row in query.select(con, sql, root=root).read_all().to_pylist()
        ]
