"""`kb.load`: data roots, releases, SQL and notebooks."""

import shutil
from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.artifacts.release_folder import tombstone_lines
from kb.core.errors import KbError, UsageError
from kb.reader.wiki_page import COLOURS
from kb.store.layout import Layout
from kb.store.state import tombstones
from kb.store.tables.shard_writer import write_table
from tests.cli.test_app import NOT_FOR_HELP, imports_of


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


def test_one_folder_by_any_name_several_and_a_data_root(
    release: Path, root: Path, tmp_path: Path
) -> None:
    shutil.copytree(release / "youtube", tmp_path / "zenodo 1234")
    one = kb.load(tmp_path / "zenodo 1234")
    names = ("videos", "playlists", "playlist_videos", "tombstones")
    assert set(one.tables) == {f"youtube_{name}" for name in names}
    several = kb.load(tmp_path / "zenodo 1234", str(release / "pairs"))
    assert several.sql("SELECT count(*) AS n FROM pairs JOIN youtube_videos USING (video_id)")
    assert {"pairs", "youtube_videos"} <= set(
        kb.load([release / "pairs", release / "youtube"]).tables
    )
    with pytest.raises(UsageError, match=r"release\.youtube_\w+ is in .* and in "):
        kb.load(tmp_path / "zenodo 1234", release)
    whole = kb.load(root)
    assert "description" in whole["youtube_videos"].schema.names
    assert "description" not in whole["release.youtube_videos"].schema.names
    assert "restored.reddit_posts" in whole.tables


def test_a_root_of_one_source_only(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "clean" / "youtube", tmp_path / "clean" / "youtube")
    data = kb.load(tmp_path)
    assert all(name.startswith("youtube_") for name in data.tables)
    assert len(data["youtube_videos"]) == 207
    for ask in (lambda: data.page("Saltstone"), lambda: data.thread("x"), lambda: data.clips("x")):
        with pytest.raises(UsageError):
            ask()


def test_sql_reads_and_does_nothing_else(release: Path) -> None:
    data = kb.load(release)
    answer = data.sql("SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY ALL")
    pattern = literal(release / "pairs" / "pairs-*.parquet")
    assert [tuple(row.values()) for row in answer] == direct(
        f"SELECT keyword, count(*) FROM {pattern} GROUP BY ALL ORDER BY ALL"
    )
    assert answer.to_pandas().shape == (len(answer), 2)
    for wrong in ("DROP VIEW pairs", "COPY pairs TO 'x.csv'", "SELECT * FROM '/etc/passwd'"):
        with pytest.raises(UsageError):
            data.sql(wrong)
    with pytest.raises(UsageError, match="youtube_videos") as caught:
        data.sql("FROM youtube_video")
    assert caught.value.hint == "data.tables lists the tables"
    assert caught.value.__notes__ == [caught.value.hint]


def orphaned(release: Path) -> str:
    """A post with a comment whose parent was left out."""
    pattern = literal(release / "reddit" / "comments-*.parquet")
    return str(direct(f"SELECT min(post_id) FROM {pattern} WHERE NOT parent_in_release")[0][0])


def test_everything_shows_itself_in_a_notebook(release: Path, root: Path) -> None:
    for place in (release, root):
        data = kb.load(place)
        page = data.page("Saltstone")
        shown = [
            data,
            data.tables,
            data["youtube_videos"],
            data.sql("FROM pairs LIMIT 3"),
            page,
            page.boxes("table"),
            data.thread(orphaned(release)),
        ]
        for one in shown:
            text = one._repr_html_()
            assert text.startswith("<div")
            assert text.count("<div") == text.count("</div>")
            assert len(text) < 100_000
        assert "data:image/jpeg" in page._repr_html_()
        assert page.boxes("table")._repr_html_() != page._repr_html_()


def test_import_kb_loads_nothing_heavy_and_no_picture_before_it_is_asked_for() -> None:
    heavy = set(NOT_FOR_HELP)
    assert not heavy & imports_of("import kb; assert 'load' in dir(kb)")
    assert not {"polars", "PIL", "pydantic", "matplotlib"} & imports_of("import kb; kb.load")


def test_clips_join_pairs_videos_and_texts(release: Path, root: Path) -> None:
    clips = kb.load(release).clips("creeper").to_pylist()
    pairs, videos = (
        literal(release / folder / f"{folder if folder == 'pairs' else 'videos'}-*.parquet")
        for folder in ("pairs", "youtube")
    )
    assert [(row["pair_id"], row["title"], row["clip_end_s"]) for row in clips] == direct(
        f"SELECT pair_id, title, clip_end_s FROM {pairs} JOIN {videos} USING (video_id)"
        " WHERE keyword = 'Creeper' ORDER BY video_id, clip_start_s, pair_id"
    )
    assert {row["text"] for row in clips} == {None}
    first = clips[0]
    assert first["url"].endswith(f"?v={first['video_id']}&t={int(first['clip_start_s'])}s")
    whole = kb.load(root).clips("CREEPER").to_pylist()
    assert len(whole) == len(clips)
    assert all("creeper" in row["text"].lower() for row in whole)
    alone = kb.load(release / "pairs").clips("Creeper").to_pylist()
    assert {row["title"] for row in alone} == {None}
    by_word = kb.load(root).clips("creeper", "timing = 'word' AND clip_start_s > 20").to_pylist()
    assert by_word == [r for r in whole if r["timing"] == "word" and r["clip_start_s"] > 20] != []
    with pytest.raises(UsageError, match="timin"):
        kb.load(release).clips("creeper", "timin = 'word'")
    with pytest.raises(UsageError, match="Did you mean Creeper"):
        kb.load(release).clips("crepeer")


def test_a_thread_has_every_comment_once_under_its_parent(release: Path) -> None:
    data = kb.load(release)
    post = orphaned(release)
    thread = data.thread(f"t3_{post}")
    pattern = literal(release / "reddit" / "comments-*.parquet")
    rows = direct(
        f"SELECT comment_id, parent_id, parent_in_release FROM {pattern} WHERE post_id = '{post}'"
    )
    assert sorted(one.comment_id for _, one in thread.walk()) == sorted(row[0] for row in rows)
    assert {one.comment_id for one in thread.orphans} == {row[0] for row in rows if not row[2]}
    parents = {row[0]: row[1] for row in rows}
    for _, one in thread.walk():
        for reply in one.replies:
            assert parents[reply.comment_id] == f"t1_{one.comment_id}"
    assert {parents[one.comment_id] for one in thread.replies} <= {f"t3_{post}"}
    assert thread.title is None
    assert all(one.body is None for _, one in thread.walk())
    assert "missing (deleted or filtered out)" in str(thread)
    assert "missing (deleted" in thread._repr_html_()


def test_a_release_and_what_was_restored_of_it(release: Path, root: Path, tmp_path: Path) -> None:
    """The root that `kb restore` made, or the folder that it names at its end."""
    place = Layout(tmp_path)
    shutil.copytree(root / "export" / "reconstructed", place.restored("reddit"))
    place.restored("pairs").mkdir()
    shutil.copy(root / "pairs" / "pairs-00000-of-00001.parquet", place.restored("pairs"))
    post = orphaned(release)
    for restored in (tmp_path, place.restored()):
        for places in ((release, restored), (restored, release)):
            data = kb.load(*places)
            assert data.thread(post).title
            assert all(clip["text"] for clip in data.clips("creeper"))
            assert data.page("Creeper").title == "Creeper"


def test_texts_come_from_clean_or_from_what_was_restored(
    release: Path, root: Path, tmp_path: Path
) -> None:
    post = orphaned(release)
    clean = kb.load(root).thread(post)
    assert clean.title
    assert all(one.body for _, one in clean.walk())
    restored = kb.load(release, root / "export" / "reconstructed").thread(post)
    assert str(restored) == str(clean)
    # What a later release removed stays out of an older copy of its texts.
    first = clean.replies[0]
    shutil.copytree(release / "reddit", tmp_path / "release" / "reddit")
    tombstones.add_tombstones(tmp_path, "reddit", [(f"t1_{first.comment_id}", "deleted")])
    lines = tombstone_lines(tombstones.tombstone_rows(tmp_path, "reddit"))
    (tmp_path / "release" / "reddit" / "tombstones.ndjson").write_text(lines)
    (tmp_path / "release" / "reddit" / "SHA256SUMS").unlink()
    later = kb.load(tmp_path / "release", root / "export" / "reconstructed").thread(post)
    assert first.comment_id not in str(later)
    assert first.body not in later._repr_html_()
    assert {one.comment_id for one in first.replies} <= {one.comment_id for one in later.orphans}
    tombstones.add_tombstones(tmp_path, "reddit", [(f"t3_{post}", "deleted")])
    with pytest.raises(UsageError, match="was removed: deleted"):
        kb.load(tmp_path).thread(post)


def test_parents_that_lead_round_in_a_circle_are_orphans(tmp_path: Path, make_rows) -> None:
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    given = {"comment_id": ["a", "b", "c"], "post_id": ["p"] * 3}
    given |= {"parent_id": ["t1_b", "t1_a", "t1_c"]}
    comments = make_rows("reddit/comments", 3, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert sorted(one.comment_id for _, one in thread.walk()) == ["a", "b", "c"]
    assert len(thread.orphans) == 3


def test_a_deep_thread_has_no_limit(tmp_path: Path, make_rows) -> None:
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    parents = ["t3_p", *(f"t1_c{at:05d}" for at in range(2_999))]
    given = {"comment_id": [f"c{at:05d}" for at in range(3_000)], "post_id": ["p"] * 3_000}
    comments = make_rows("reddit/comments", 3_000, parent_id=parents, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert [level for level, _ in thread.walk()] == list(range(3_000))
    assert "and 2,900 more" in thread._repr_html_()


def test_boxes_are_returned_and_drawn_where_they_are(release: Path) -> None:
    page = kb.load(release).page("Saltstone")
    pattern = literal(release / "wiki" / "elements-*.parquet")
    rows = direct(
        f"SELECT element_id, x, y, width, height FROM {pattern} WHERE kind = 'cell' AND visible"
        f" AND page_id = {page.page_id} ORDER BY reading_order"
    )
    boxes = page.boxes("cell")
    assert [(box.element_id, box.x, box.y, box.width, box.height) for box in boxes] == rows
    plain, drawn = page.screenshot().convert("RGB"), boxes.draw()
    colour = tuple(bytes.fromhex(COLOURS["cell"][1:]))
    for _, x, y, width, height in rows:
        assert drawn.getpixel((round(x + width / 2), round(y))) == colour
        middle = (round(x + width / 2), round(y + height / 2))
        assert drawn.getpixel(middle) == plain.getpixel(middle)
    assert drawn.getpixel((1, 1)) == plain.getpixel((1, 1))
    assert len(page.boxes()) > len(boxes)
    assert all(box.kind == "table" for box in page.boxes("table"))
    with pytest.raises(UsageError, match="'tabel'"):
        page.boxes("tabel")


def test_facts_and_recipes_of_a_page(release: Path) -> None:
    data = kb.load(release)
    facts = [(row["field"], row["value"], row["unit"]) for row in data.page("Saltstone").facts]
    assert facts == [("Hardness", "3", None), ("Melts", "in rain", None)]
    rows = list(data.page("Net loom").recipes)
    shown = [(row["role"], row["slot"], row["item"], row["quantity"]) for row in rows]
    assert shown[:2] == [("input", 0, "Cord 0", 1), ("input", 0, "Cord 1", 1)]
    assert shown[-1] == ("output", 4, "Net", 2)
    assert list(data.page("Saltstone").recipes) == []


def test_a_download_is_searched_and_nothing_is_written_into_it(
    release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for place in (release, release / "wiki"):
        answers = kb.load(place).search("saltstone", source="wiki").to_pylist()
        assert answers[0]["title"] == "Saltstone"
        assert "**" in answers[0]["snippet"]
    assert kb.load(release).search("the", source="youtube").to_pylist()  # titles
    assert any(tmp_path.rglob("_manifest.json"))
    with pytest.raises(KbError, match="has no texts of reddit") as caught:
        kb.load(release / "reddit").search("saltstone", source="reddit")
    assert "kb restore" in caught.value.hint
