"""Screenshots from tars and data roots."""

import io
import shutil
import sys
import tarfile
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from PIL import Image

import kb
from kb.core.errors import DamagedData, MissingExtra
from kb.reader.wiki_page import COLOURS
from kb.store.artifact_registry import SUMS


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
