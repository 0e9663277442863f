"""Tables and their conversions."""

import sys
from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import kb
from kb.core.errors import DamagedData, MissingExtra, UsageError
from kb.store.artifact_registry import SUMS
from kb.store.tables.checksums import listed

RELEASED = {
    "pairs",
    "reddit_comments",
    "reddit_posts",
    "wiki_cells",
    "wiki_elements",
    "wiki_facts",
    "wiki_images",
    "wiki_pages",
    "wiki_recipes",
    "youtube_videos",
}


def test_every_table_of_a_release_and_its_ways_out(release: Path) -> None:
    data = kb.load(release)
    assert set(data.tables) >= RELEASED
    assert "transcripts" not in " ".join(data.tables)
    videos = data["youtube_videos"]
    shards = sorted((release / "youtube").glob("videos-*.parquet"))
    whole = pq.read_table(shards[0])
    assert videos.to_table().equals(whole)
    assert videos.schema.names == whole.schema.names
    assert videos.schema.field("fps").metadata[b"doc"]
    assert len(videos) == videos.count_rows() == whole.num_rows
    assert videos.to_pandas()["video_id"].tolist() == whole["video_id"].to_pylist()
    assert videos.to_polars()["view_count"].to_list() == whole["view_count"].to_pylist()
    some = videos.to_table(["video_id"], filter=pc.field("view_count") > 100_000)
    assert some.num_rows == pc.sum(pc.greater(whole["view_count"], 100_000)).as_py() > 0
    assert videos.dataset.count_rows() == whole.num_rows


@pytest.mark.parametrize("cut", [0, 100, 1_000])
def test_a_damaged_shard_is_named_when_it_is_read(folder: Path, cut: int) -> None:
    path = folder / "posts-00002-of-00003.parquet"
    path.write_bytes(path.read_bytes()[:cut])
    data = kb.load(folder)
    for read in (
        lambda: data["reddit_posts"].to_table(),
        lambda: data["reddit_posts"].to_pandas(),
        lambda: len(data["reddit_posts"]),
        lambda: data.tables._repr_html_(),
        lambda: data.sql("SELECT count(*) FROM reddit_posts"),
        lambda: data.thread("x"),
    ):
        with pytest.raises(DamagedData, match=r"posts-00002-of-00003\.parquet"):
            read()
    assert len(data["reddit_comments"]) == 5


def test_a_changed_bit_is_told_by_rows_and_by_counts(folder: Path) -> None:
    path = folder / "posts-00002-of-00003.parquet"
    (folder / SUMS).write_text(listed(sorted(folder.glob("*.parquet"))))
    data = bytearray(path.read_bytes())
    data[60] ^= 1  # in a page
    path.write_bytes(data)
    posts = kb.load(folder)["reddit_posts"]
    assert (len(posts), posts.schema.names[0]) == (12, "post_id")  # the footers are whole
    for read in (
        posts.to_table,
        lambda: posts.dataset,
        lambda: kb.load(folder).sql("SELECT count(*) FROM reddit_posts"),
        lambda: kb.load(folder).thread("x"),
    ):
        with pytest.raises(DamagedData, match=f"{path.name} can't be read: checksum mismatch"):
            read()


def test_damaged_pages_of_a_shard_with_a_good_footer(folder: Path) -> None:
    path = folder / "posts-00000-of-00003.parquet"
    held = bytearray(path.read_bytes())
    held[4:200] = bytes(196)
    path.write_bytes(bytes(held))
    data = kb.load(folder)
    for read in (
        lambda: data["reddit_posts"].to_table(),
        lambda: data.sql("FROM reddit_posts ORDER BY ALL"),
    ):
        with pytest.raises(DamagedData, match=r"posts-00000-of-00003\.parquet can't be read"):
            read()


def test_names_that_are_not_there(folder: Path) -> None:
    data = kb.load(folder)
    with pytest.raises(KeyError, match="Did you mean reddit_posts"):
        data["reddit_post"]
    assert data.tables.get("nothing") is None
    with pytest.raises(UsageError, match="no column 'scor'"):
        data["reddit_posts"].to_table(["scor"])


@pytest.mark.parametrize(("package", "way"), [("pandas", "to_pandas"), ("polars", "to_polars")])
def test_a_package_that_is_not_installed_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, package: str, way: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match=f"{package} is not installed") as caught:
        getattr(kb.load(folder)["reddit_posts"], way)()
    assert caught.value.hint == f"install the package {package}"
