"""Tables and their conversions."""

import gc
import shutil
import sys
from pathlib import Path

import duckdb
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import kb
from kb.core.errors import DamagedData, FatalError, MissingExtra, UsageError
from kb.reader.hints import with_hints
from kb.reader.tables import OpenTables
from kb.store.artifact_registry import SUMS
from kb.store.tables.checksums import listed
from kb.store.tables.shard_writer import write_table

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
    assert videos.to_arrow(["video_id"]).equals(whole.select(["video_id"]))
    assert data.sql("FROM youtube_videos").to_arrow().num_rows == whole.num_rows
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


def test_what_people_wrote_is_escaped(tmp_path: Path, make_rows) -> None:
    evil = '<script>alert("1")</script>\x1b[31m'
    given = {"post_id": ["p1"], "title": [evil], "body": [evil]}
    posts = make_rows("reddit/posts", 1, **given)
    write_table(tmp_path / "clean/reddit/posts/part-00000.parquet", posts, "reddit/posts")
    given = {"comment_id": ["c1"], "post_id": ["p1"], "parent_id": ["t3_p1"], "body": [evil]}
    comments = make_rows("reddit/comments", 1, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    data = kb.load(tmp_path)
    assert data.thread("p1").replies[0].body == evil
    for shown in (data["reddit_posts"], data.sql("FROM reddit_comments"), data.thread("p1")):
        text = shown._repr_html_()
        assert "&lt;script&gt;" in text
        assert "<script" not in text
        assert "\x1b" not in text
    assert "\x1b" not in str(data.thread("p1"))


def test_a_hint_becomes_a_note_once() -> None:
    @with_hints
    def inner() -> None:
        raise UsageError("no such table", hint="see data.tables")

    with pytest.raises(UsageError) as caught:
        with_hints(inner)()
    assert caught.value.__notes__ == ["see data.tables"]


def test_other_errors_and_results_are_unchanged() -> None:
    assert with_hints(len)([1, 2]) == 2
    with pytest.raises(TypeError) as caught:
        with_hints(len)(3)
    assert not hasattr(caught.value, "__notes__")
