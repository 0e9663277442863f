"""A release at an address: the same tables as in its folder, read-only."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

import kb
from kb.artifacts import remote_release
from kb.core.errors import DamagedData, FatalError, UsageError

PLACE = "memory://lore"


@pytest.fixture
def memory(demo: Path) -> Iterator[fsspec.AbstractFileSystem]:
    """The demo's release in this process's memory."""
    system = fsspec.filesystem("memory")
    system.put(f"{demo}/data/demo/release/", "/lore/", recursive=True)
    yield system
    system.rm("/lore", recursive=True)


def test_every_table_equals_the_folders(memory: fsspec.AbstractFileSystem, demo: Path) -> None:
    here, there = kb.load(demo / "data" / "demo" / "release"), kb.load(PLACE)
    assert [one.name for one in there.tables.all()] == [one.name for one in here.tables.all()]
    for one, other in zip(here.tables.all(), there.tables.all(), strict=True):
        assert other.schema.equals(one.schema, check_metadata=True), one.name
        assert other.to_table().equals(one.to_table()), one.name
        assert len(other) == len(one)
    asked = "SELECT keyword, count(*) AS n FROM pairs GROUP BY ALL ORDER BY ALL"
    assert there.sql(asked).to_table().equals(here.sql(asked).to_table())
    one, other = here.page("Saltstone"), there.page("Saltstone")
    assert other.screenshot().tobytes() == one.screenshot().tobytes()
    assert list(other.boxes()) == list(one.boxes())
    assert there.clips().to_table().equals(here.clips().to_table())
    post = here["reddit_posts"].to_pylist(["post_id"])[0]["post_id"]
    assert str(there.thread(post)) == str(here.thread(post))
    assert "memory://lore/youtube" in repr(there)
    assert there._repr_html_()


def test_it_can_only_be_read(memory: fsspec.AbstractFileSystem) -> None:
    before = memory.find("/lore", detail=True)
    data = kb.load(f"{PLACE}/pairs")
    assert {"pairs", "pairs_quality"} <= set(data.tables)
    for wrong in ("DROP VIEW pairs", "COPY pairs TO 'x.csv'", "SELECT * FROM 'memory://lore/x'"):
        with pytest.raises(UsageError):
            data.sql(wrong)
    with pytest.raises(UsageError, match="can't be searched"):
        data.search("creeper")
    assert memory.find("/lore", detail=True) == before


def test_folders_on_this_machine_and_at_addresses_together(
    memory: fsspec.AbstractFileSystem, demo: Path, tmp_path: Path
) -> None:
    shutil.copytree(demo / "data" / "demo" / "release" / "youtube", tmp_path / "videos")
    data = kb.load(tmp_path / "videos", f"{PLACE}/pairs")
    assert len(data.sql("FROM pairs JOIN youtube_videos USING (video_id)"))
    with pytest.raises(UsageError, match=r"release\.youtube_\w+ is in .* and in memory"):
        kb.load(tmp_path / "videos", PLACE)


def test_what_is_not_a_whole_release_is_refused(memory: fsspec.AbstractFileSystem) -> None:
    memory.pipe("/lore/other/notes.txt", b"notes")
    with pytest.raises(FatalError, match="no release in memory://lore/other"):
        remote_release.read_views(f"{PLACE}/other")
    (shard,) = memory.glob("/lore/youtube/videos-*.parquet")
    memory.rm(shard)
    with pytest.raises(DamagedData, match=r"memory://lore/youtube/videos-.* is missing"):
        remote_release.read_views(PLACE)
    memory.rm("/lore/youtube/SHA256SUMS")
    memory.pipe(shard, b"PAR1")
    with pytest.raises(DamagedData, match="has no SHA256SUMS"):
        remote_release.read_views(PLACE)


def test_a_damaged_footer_is_told_by_the_address(memory: fsspec.AbstractFileSystem) -> None:
    (shard,) = memory.glob("/lore/youtube/videos-*.parquet")
    memory.pipe(shard, memory.cat(shard)[:-100])
    data = kb.load(PLACE)
    for read in (data["youtube_videos"].head, lambda: data.sql("FROM youtube_videos")):
        with pytest.raises(DamagedData, match="memory://lore/youtube/videos"):
            read()
