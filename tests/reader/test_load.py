"""kb.load on the demo's release and data root: what a notebook gets, checked against the files."""

from __future__ import annotations

import io
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from PIL import Image

import kb
from kb.core.errors import KbError, UsageError
from kb.reader.screenshots import COLOURS
from kb.store import tombstones

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


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


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


def test_one_folder_by_any_name_several_and_a_data_root(
    release: Path, root: Path, tmp_path: Path
) -> None:
    shutil.copytree(release / "youtube", tmp_path / "zenodo 1234")
    one = kb.load(tmp_path / "zenodo 1234")
    assert set(one.tables) == {"youtube_videos", "youtube_tombstones"}
    several = kb.load(tmp_path / "zenodo 1234", str(release / "pairs"))
    assert several.sql("SELECT count(*) AS n FROM pairs JOIN youtube_videos USING (video_id)")
    assert {"pairs", "youtube_videos"} <= set(
        kb.load([release / "pairs", release / "youtube"]).tables
    )
    with pytest.raises(UsageError, match=r"release\.youtube_videos is in .* and in "):
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


@pytest.mark.parametrize("where", ["release", "root"])
def test_a_screenshot_is_the_picture_that_was_taken(where: str, release: Path, root: Path) -> None:
    data = kb.load(release if where == "release" else root)
    row = data.sql("SELECT page_id, title FROM wiki_pages ORDER BY page_id").to_pylist()[1]
    page = data.page(row["title"])
    assert data.page(row["page_id"]).title == data.page(row["title"].upper()).title == page.title
    (tar,) = (release / "wiki").glob("screenshots-*.tar")
    with tarfile.open(tar) as opened:
        file = opened.extractfile(f"{row['page_id']:09d}.png")
        assert file is not None
        wanted = Image.open(io.BytesIO(file.read()))
    assert page.screenshot().tobytes() == wanted.tobytes()


def test_a_release_without_its_index_has_its_pictures_all_the_same(
    release: Path, tmp_path: Path
) -> None:
    shutil.copytree(release / "wiki", tmp_path / "wiki")
    (tmp_path / "wiki" / "index.ndjson").unlink()
    page, indexed = (kb.load(one).page("Saltstone") for one in (tmp_path / "wiki", release))
    assert page.screenshot().tobytes() == indexed.screenshot().tobytes()


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


def test_texts_are_drawn_line_by_line(release: Path) -> None:
    """The paragraph beside the infobox has a box that reaches over it, and lines that don't."""
    page = kb.load(release).page("Saltstone")
    texts = page.boxes("text")
    (infobox,) = (box for box in page.boxes("table") if box.region == "infobox")
    over = [box for box in texts if box.tag == "p" and box.x + box.width > infobox.x > box.x]
    over = [box for box in over if box.y < infobox.y + infobox.height]
    assert over
    drawn = texts.draw()
    colour = tuple(bytes.fromhex(COLOURS["text"][1:]))
    for box in over:
        assert box.lines
        assert all(line.x + line.width <= infobox.x for line in box.lines)
        for line in box.lines:
            assert drawn.getpixel((round(line.x + line.width / 2), round(line.y))) == colour
        assert drawn.getpixel((round(infobox.x + 2), round(box.y))) != colour
    assert {box.lines for box in page.boxes("cell")} == {None}


def test_facts_and_recipes_of_a_page(release: Path) -> None:
    data = kb.load(release)
    facts = [(row["field"], row["value"], row["unit"]) for row in data.page("Saltstone").facts]
    assert facts == [("Hardness", "3", None), ("Melts", "in rain", None)]
    rows = list(data.page("Net loom").recipes)
    shown = [(row["role"], row["slot"], row["item"], row["quantity"]) for row in rows]
    assert shown[:2] == [("input", 0, "Cord 0", 1), ("input", 0, "Cord 1", 1)]
    assert shown[-1] == ("output", 4, "Net", 2)
    assert list(data.page("Saltstone").recipes) == []


def orphaned(release: Path) -> str:
    """A post with a comment whose parent was left out."""
    pattern = literal(release / "reddit" / "comments-*.parquet")
    return str(direct(f"SELECT min(post_id) FROM {pattern} WHERE NOT parent_in_release")[0][0])


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
    (tmp_path / "release" / "reddit" / "tombstones.ndjson").unlink()
    tombstones.add(tmp_path, "reddit", [(f"t1_{first.comment_id}", "deleted")])
    shutil.copy(tmp_path / "raw" / "reddit" / "tombstones.parquet", tmp_path / "release" / "reddit")
    later = kb.load(tmp_path / "release", root / "export" / "reconstructed").thread(post)
    assert first.comment_id not in str(later)
    assert first.body not in later._repr_html_()
    assert {one.comment_id for one in first.replies} <= {one.comment_id for one in later.orphans}
    tombstones.add(tmp_path, "reddit", [(f"t3_{post}", "deleted")])
    with pytest.raises(UsageError, match="was removed: deleted"):
        kb.load(tmp_path).thread(post)


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
    with pytest.raises(UsageError, match="Did you mean Creeper"):
        kb.load(release).clips("crepeer")


def test_a_download_is_searched_and_nothing_is_written_into_it(
    release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for place in (release, release / "wiki"):
        answers = kb.load(place).search("saltstone", source="wiki").to_pylist()
        assert answers[0]["title"] == "Saltstone"
        assert "**" in answers[0]["snippet"]
    assert kb.load(release).search("the", source="youtube").to_pylist()  # titles
    assert any(tmp_path.rglob("note.json"))
    with pytest.raises(KbError, match="has no texts of reddit") as caught:
        kb.load(release / "reddit").search("saltstone", source="reddit")
    assert "kb restore" in caught.value.hint


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
