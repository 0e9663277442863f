"""The page needs nothing outside itself, and texts stay texts."""

import re
from collections.abc import Callable
from pathlib import Path

from tests.report.made import OfOne


def test_what_people_wrote_is_text_and_never_markup(of_one: Callable[[str], OfOne]) -> None:
    page = of_one("reddit").page
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_page_needs_nothing_outside_itself(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert re.findall(r"<(?:script|link|iframe|object)", page) == []
    assert all(source.startswith("data:") for source in re.findall(r'src="([^"]*)"', page))
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', page))
    assert all(text.strip() for text in re.findall(r'alt="([^"]*)"', page))
    assert len(re.findall(r"<figure ", page)) == 28


def test_the_page_says_that_its_texts_may_not_be_passed_on(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert page.index("may not be passed on") < page.index("<figure ")
