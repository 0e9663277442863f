"""Answers as `kb search` gives them, and what surrounds them."""

import html
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

import kb
from kb.artifacts import index
from kb.store.artifact_registry import MANIFEST
from tests.explore.conftest import UNPRIVILEGED, Explored, explored
from tests.inprocess import Here


@pytest.fixture(scope="module")
def indexed(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's root without its index: the pages build it."""
    root = tmp_path_factory.mktemp("indexed") / "demo"
    shutil.copytree(demo / "data" / "demo", root, ignore=shutil.ignore_patterns("index"))
    return root


@pytest.fixture(scope="module")
def pages(indexed: Path) -> Iterator[Explored]:
    with explored(indexed) as one:
        yield one


def addresses(text: str) -> list[str]:
    return [html.unescape(one) for one in re.findall(r'href="(/document\?.*?)#here"', text)]


def test_answers_are_those_of_kb_search(pages: Explored, indexed: Path, here: Here) -> None:
    words = ("creeper", "--data", str(indexed), "--source", "wiki", "--limit", "50", "--json")
    expected = json.loads(here("search", *words).out.splitlines()[-1])["answers"]
    titles: list[str] = []
    for page in (1, 2, 3):
        text = pages.ask(f"/search?words=creeper&source=wiki&page={page}").text
        titles += re.findall(r"/document\?.*?>(.*?)</a></h2>", text)
        assert ('rel="next"' in text) == (len(titles) < len(expected))
    shown = [one["title"] + (f" › {one['path']}" if one["path"] else "") for one in expected]
    assert [html.unescape(title) for title in titles] == shown


def test_a_transcript_opens_where_the_words_are_said(pages: Explored) -> None:
    found = addresses(pages.ask("/search?words=creeper&kind=transcript").text)
    answer = pages.ask(found[0])
    assert answer.status == 200
    here = answer.text.partition('id="here"')[2].partition("</section>")[0]
    assert "creeper" in here.lower()
    assert re.search(r'href="https://www\.youtube\.com/watch\?v=[\w-]+&amp;t=\d+s"', here)


def test_a_section_has_its_boxes_on_the_screenshot(pages: Explored) -> None:
    found = addresses(pages.ask("/search?words=creeper&kind=section").text)
    text = pages.ask(found[0]).text
    width, height = (float(one) for one in re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text)[-1])
    boxes = re.findall(
        r'<rect x="([\d.-]+)" y="([\d.-]+)" width="([\d.]+)" height="([\d.]+)"', text
    )
    assert boxes
    for x, y, w, h in (map(float, box) for box in boxes):
        assert 0 <= x <= x + w <= width + 1
        assert 0 <= y <= y + h <= height + 1
    (picture,) = re.findall(r'<image href="(.*?)"', text)
    status, kind = pages.image(html.unescape(picture))
    assert (status, kind) == (200, b"\x89PNG\r\n\x1a\n")


def test_a_comment_opens_in_its_thread(pages: Explored) -> None:
    found = addresses(pages.ask("/search?words=creeper&kind=comment").text)
    text = pages.ask(found[0]).text
    assert ">post</a>" in text
    here = text.partition('id="here"')[2].partition("</section>")[0]
    assert "creeper" in here.lower()
    assert "https://www.reddit.com/comments/" in here


def test_a_misspelt_word_gets_a_suggestion(pages: Explored) -> None:
    text = pages.ask("/search?words=creepr").text
    assert "Nothing has these words; read as" in text
    assert "words=creeper" in text


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/search?words=x&since=monday", "since is 'monday'; write it like 2023-01-31"),
        ("/search?words=x&least=much", "the minimum score is 'much', not a number"),
        ("/search?words=x&source=usenet", "unknown source 'usenet'"),
        ("/document?ref=nothing", "invalid reference 'nothing'"),
        ("/document?ref=wiki:999999999", "unknown page '999999999'"),
        (f"/screenshot?ref={quote('youtube:-adgY6nLGBx')}", "no screenshot"),
    ],
)
def test_a_wrong_question_gets_one_clear_line(pages: Explored, path: str, said: str) -> None:
    answer = pages.ask(path)
    assert answer.status == 400
    assert said in html.unescape(answer.text)
    assert ('<input type="search"' in answer.text) == path.startswith("/search")


@pytest.fixture
def wiki(demo: Path, tmp_path: Path) -> Path:
    """A root with the demo's wiki alone, and no index."""
    shutil.copytree(demo / "data" / "demo" / "clean" / "wiki", tmp_path / "root" / "clean" / "wiki")
    return tmp_path / "root"


def test_an_index_that_is_missing_or_old_is_built_at_the_start(wiki: Path, demo: Path) -> None:
    with explored(wiki) as pages:
        assert addresses(pages.ask("/search?words=creeper").text)
    assert [path.name for path in (wiki / "index").iterdir()] == ["wiki"]
    clean = demo / "data" / "demo" / "clean"
    shutil.copytree(clean / "reddit", wiki / "clean" / "reddit")
    manifest = wiki / "index" / "wiki" / MANIFEST
    manifest.write_text(re.sub(r'"rules": "[^"]*"', '"rules": "0 en"', manifest.read_text()))
    with explored(wiki) as pages:
        assert addresses(pages.ask("/search?words=creeper&source=reddit").text)
    assert '"rules": "0 en"' not in manifest.read_text(), "an older version has built it"


def test_a_root_that_cannot_be_written_has_its_index_in_the_cache(
    wiki: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = wiki.parent / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    wiki.chmod(0o555)
    before = sorted(wiki.rglob("*"))
    for _ in range(2):  # built, and then found
        with explored(wiki, before=UNPRIVILEGED) as pages:
            assert addresses(pages.ask("/search?words=creeper").text)
    assert sorted(wiki.rglob("*")) == before
    (built,) = cache.glob(f"lorecrawl/downloads/*/index/wiki/{MANIFEST}")
    wiki.chmod(0o755)
    with explored(wiki) as pages:
        assert addresses(pages.ask("/search?words=creeper").text)
    assert (wiki / "index" / "wiki" / MANIFEST).is_file()
    index.remove(wiki, "wiki")
    assert not built.exists(), "a purge leaves no byte of it"


def test_search_keeps_its_form_while_the_index_is_replaced(wiki: Path, here: Here) -> None:
    """As by a second demo: the tables go, then come back, then the index does."""
    moved = wiki.with_name("moved")
    with explored(wiki) as pages:
        (wiki / "clean").rename(moved)
        gone = pages.ask("/search?words=creeper")
        moved.rename(wiki / "clean")
        shutil.rmtree(wiki / "index")
        missing = pages.ask("/search?words=creeper")
        assert here("index", "--data", str(wiki), "--quiet").code == 0
        assert addresses(pages.ask("/search?words=creeper").text)
    for answer, said in ((gone, "nothing to search"), (missing, "index of wiki is missing")):
        assert answer.status == 200
        assert said in answer.text
        assert '<input type="search" name="words" value="creeper">' in answer.text


def test_a_pages_document_shows_what_its_thing_is_made_of(demo: Path, demo_pages: Explored) -> None:
    tree = kb.load(demo / "data" / "demo").recipe_tree("Crafting Table")
    page = demo_pages.ask(f"/document?ref=wiki:{tree['page_id']}").text
    assert f"1 × Crafting Table ({tree['station']})" in page
    for need in tree["needs"]:
        assert f"{need['quantity']:,} × {need['item']}" in page
        assert f'href="/document?ref=wiki%3A{need["page_id"]}"' in page
