"""A release of the demo, and a small one with three shards."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.store.tables.shard_writer import write_table


@pytest.fixture(scope="module")
def root(demo: Path) -> Path:
    return demo / "data" / "demo"


@pytest.fixture(scope="module")
def release(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The release folders alone, as somebody downloaded them; nothing in them may change."""
    folder = tmp_path_factory.mktemp("down[load]ed") / "release"
    shutil.copytree(root / "release", folder)
    before = state_of(folder)
    yield folder
    assert state_of(folder) == before


def state_of(folder: Path) -> dict[str, tuple[int, int]]:
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in folder.rglob("*")}


@pytest.fixture
def folder(tmp_path: Path, make_rows) -> Path:
    """A release folder with three shards of posts, and comments."""
    folder = tmp_path / "it's a #1 [release]"
    for at in range(3):
        rows = make_rows("reddit/posts", 4, released=True)
        write_table(
            folder / f"posts-{at:05d}-of-00003.parquet", rows, "reddit/posts", released=True
        )
    rows = make_rows("reddit/comments", 5, released=True)
    write_table(folder / "comments-00000-of-00001.parquet", rows, "reddit/comments", released=True)
    return folder
