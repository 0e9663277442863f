"""A source whose ids are any text, and whose list goes on by cursors, loses nothing."""

import shutil
from pathlib import Path

import pytest

from tests.fourth.service import PAGE, TextSite, serving
from tests.fourth.test_fourth_source import PACKAGE, Place, install, raw, read

IDS = [
    *("a/b", "what?", "hash#tag", "50% of it", "a+b&c=d", "semi;colon", "semi", "日本"),
    *("550e8400-e29b-41d4-a716-446655440000", "1", "%2F", "[x]:@!$'()*,", "quiz", "uiz", "apple"),
]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    package = shutil.copytree(PACKAGE, tmp_path_factory.mktemp("package") / "changed")
    lists = package / "qanda/lists.py"
    pages = 'path="/questions",'
    assert pages in lists.read_text()
    paged = f'{pages} following="next", page="cursor", first="",'
    lists.write_text(lists.read_text().replace(pages, paged))
    for path in (package / "qanda/schemas/raw/qanda").iterdir():
        text = path.read_text()
        for name in ("question_id", "answer_id"):
            text = text.replace(f'"{name}": {{"type": "integer"', f'"{name}": {{"type": "string"')
        path.write_text(text)
    return install(tmp_path_factory.mktemp("installed"), package)


def test_they_are_crawled_released_read_and_removed(tmp_path: Path, installed: Path) -> None:
    with serving(TextSite(IDS)) as site:
        place = Place(tmp_path, installed, site)
        crawled, *_ = place.run("qanda crawl", "build")
        assert (crawled["crawled"], crawled["missing"], crawled["failed"]) == (len(IDS), 0, 0)
        assert site.asked["/questions"] == len(IDS) // PAGE + 1
        assert place.released("questions") == sorted(IDS)
        assert place.released("answers") == sorted(f"{key}, first" for key in IDS)
        (answer,) = place.run("search furnace --kind answer --limit 20")
        assert len({found["key"] for found in answer["answers"]}) == len(IDS)
        for key in ("a/b", "50% of it", "quiz", "apple"):
            ref = place.python(
                "from kb.mcp.documents import SourceLocation as At;"
                f"print(At('qanda', {key!r}, {f'{key}, first'!r}).ref)"
            )
            assert f"{key} needs a furnace" in read(place, ref)
        site.deleted = {"what?"}
        (tmp_path / "gone.txt").write_text("semi;colon\na/b\nquiz\n")
        refreshed, purged = place.run("refresh qanda --older-than 0", "purge qanda --ids gone.txt")
        assert refreshed["crawled"] == len(IDS)
        assert (purged["purged"], purged["unknown"]) == (3, 0)
        left = sorted({*IDS} - {"semi;colon", "a/b", "quiz", "what?"})
        assert place.released("questions") == left
        assert not [line for line in raw(place) if "semi;colon" in line or "a/b" in line]
        (verified,) = place.run("verify")
        assert verified["files_damaged"] == 0
