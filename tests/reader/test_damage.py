"""kb.load and what is missing, damaged, not installed, or not to be trusted."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import kb
from kb.core.errors import DamagedData, FatalError, MissingExtra, UsageError
from kb.store.checksums import SUMS, listed
from kb.store.shards import write_table
from tests.cli.test_help import NOT_FOR_HELP, imports_of


@pytest.fixture
def folder(tmp_path: Path, make_rows) -> Path:  # type: ignore[no-untyped-def]
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


def test_tars_that_are_not_there_or_not_what_they_were(demo: Path, tmp_path: Path) -> None:
    wiki = tmp_path / "wiki"
    shutil.copytree(demo / "data" / "demo" / "release" / "wiki", wiki)
    (tar,) = wiki.glob("screenshots-*.tar")
    page = kb.load(wiki).page("Saltstone")
    held = bytearray(tar.read_bytes())
    held[1_000:-1_000:500] = b"\xff" * len(held[1_000:-1_000:500])
    tar.write_bytes(bytes(held))
    with pytest.raises(DamagedData, match=rf"{tar.name} is damaged"):
        page.screenshot()
    assert "no image" in page._repr_html_()
    tar.unlink()
    with pytest.raises(DamagedData, match=rf"{tar.name} is missing"):
        page.screenshot()
    assert len(page.boxes()) > 10


@pytest.mark.parametrize("path", ["../../x.png", "/etc/passwd", "../x.tar/a.png", "..tar/../x"])
def test_no_path_in_data_leads_out_of_its_folder(demo: Path, tmp_path: Path, path: str) -> None:
    wiki = tmp_path / "down" / "wiki"
    shutil.copytree(demo / "data" / "demo" / "release" / "wiki", wiki)
    (tmp_path / "x.png").write_bytes(b"x")
    (tmp_path / "down" / "x.tar").write_bytes(b"x")
    (shard,) = wiki.glob("pages-*.parquet")
    rows = pq.read_table(shard)
    at = rows.column_names.index("screenshot_path")
    pq.write_table(rows.set_column(at, rows.field(at), [[path] * rows.num_rows]), shard)
    (wiki / SUMS).unlink()  # who makes such a folder leaves it out
    with pytest.raises(DamagedData, match="which is not in"):
        kb.load(wiki).page("Saltstone").screenshot()


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


def test_names_that_are_not_there(folder: Path) -> None:
    data = kb.load(folder)
    with pytest.raises(KeyError, match="Did you mean reddit_posts"):
        data["reddit_post"]
    assert data.tables.get("nothing") is None
    with pytest.raises(UsageError, match="no column 'scor'"):
        data["reddit_posts"].to_table(["scor"])


def test_what_people_wrote_is_escaped(tmp_path: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
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


def test_parents_that_lead_round_in_a_circle_are_orphans(tmp_path: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    given = {"comment_id": ["a", "b", "c"], "post_id": ["p"] * 3}
    given |= {"parent_id": ["t1_b", "t1_a", "t1_c"]}
    comments = make_rows("reddit/comments", 3, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert sorted(one.comment_id for _, one in thread.walk()) == ["a", "b", "c"]
    assert len(thread.orphans) == 3


def test_a_deep_thread_has_no_limit(tmp_path: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    parents = ["t3_p", *(f"t1_c{at:05d}" for at in range(2_999))]
    given = {"comment_id": [f"c{at:05d}" for at in range(3_000)], "post_id": ["p"] * 3_000}
    comments = make_rows("reddit/comments", 3_000, parent_id=parents, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert [level for level, _ in thread.walk()] == list(range(3_000))
    assert "and 2,900 more" in thread._repr_html_()


@pytest.mark.parametrize(("package", "way"), [("pandas", "to_pandas"), ("polars", "to_polars")])
def test_a_package_that_is_not_installed_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, package: str, way: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match=f"{package} is not installed") as caught:
        getattr(kb.load(folder)["reddit_posts"], way)()
    assert caught.value.hint == f"install the package {package}"


def test_pictures_need_pillow_and_nothing_else_does(
    demo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PIL", "PIL.Image", "PIL.ImageDraw"):
        monkeypatch.setitem(sys.modules, name, None)
    page = kb.load(demo / "data" / "demo" / "release").page("Saltstone")
    with pytest.raises(MissingExtra) as caught:
        page.screenshot()
    assert caught.value.hint == "install the package pillow"
    assert len(page.boxes("cell")) > 3
    assert "install the package pillow" in page._repr_html_()


def test_import_kb_loads_nothing_heavy_and_no_picture_before_it_is_asked_for() -> None:
    heavy = set(NOT_FOR_HELP)
    assert not heavy & imports_of("import kb; assert 'load' in dir(kb)")
    assert not {"polars", "PIL", "pydantic", "matplotlib"} & imports_of("import kb; kb.load")
