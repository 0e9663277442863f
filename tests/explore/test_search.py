"""Answers as `kb search` gives them, and what surrounds them."""

import html
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

from tests.explore.conftest import Explored, explored
from tests.inprocess import Here


@pytest.fixture(scope="module")
def indexed(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's root with an index of its own."""
    root = tmp_path_factory.mktemp("indexed") / "demo"
    shutil.copytree(demo / "data" / "demo", root, ignore=shutil.ignore_patterns("index"))
    return root


@pytest.fixture
def pages(indexed: Path, here: Here) -> Iterator[Explored]:
    assert here("index", "--data", str(indexed), "--quiet").code == 0
    with explored(indexed) as one:
        yield one


def addresses(text: str) -> list[str]:
    return [html.unescape(one) for one in re.findall(r'href="(/document\?.*?)#here"', text)]


def test_answers_are_those_of_kb_search(pages: Explored, indexed: Path, here: Here) -> None:
    words = ("creeper", "--data", str(indexed), "--source", "wiki", "--limit", "50", "--json")
    expected = json.loads(here("search", *words).out.splitlines()[-1])["answers"]
    text = pages.ask("/search?words=creeper&source=wiki").text
    titles = re.findall(r"/document\?.*?>(.*?)</a></h2>", text)
    shown = [one["title"] + (f" › {one['path']}" if one["path"] else "") for one in expected]
    assert [html.unescape(title) for title in titles] == shown
    assert "<mark>" in text


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
    assert "Did you mean" in text
    assert "words=creeper" in text


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/search?words=x&since=monday", "since is 'monday'; write it like 2023-01-31"),
        ("/search?words=x&least=much", "the least score is 'much', not a number"),
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


def test_without_an_index_it_says_what_to_run_and_writes_nothing(
    demo: Path, tmp_path: Path
) -> None:
    root = tmp_path / "root"
    shutil.copytree(demo / "data" / "demo" / "clean" / "wiki", root / "clean" / "wiki")
    before = sorted(root.rglob("*"))
    with explored(root) as bare:
        answer = bare.ask("/search?words=creeper")
    assert answer.status == 400
    assert "run `kb index`" in answer.text
    assert sorted(root.rglob("*")) == before
