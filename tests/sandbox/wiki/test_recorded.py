"""Tests of the recorded wiki."""

import pytest

from kb.sandbox.wiki.generated import RecordedWiki


def test_the_later_state_has_an_edit_a_deletion_a_move_and_a_new_page() -> None:
    wiki = RecordedWiki()
    first, later = wiki.pages(False), wiki.pages(True)
    assert "Charts" in first
    assert "Charts" not in later
    assert wiki.html("Charts", True) is None
    assert wiki.html("New jetty", False) is None
    assert wiki.html("New jetty", True)
    assert wiki.html("Lamp buoy", True) == wiki.html("Lamp float", True)
    both = first.keys() & later.keys()
    assert any(first[name]["lastrevid"] != later[name]["lastrevid"] for name in both)


@pytest.mark.parametrize(
    "path",
    [
        "/api/pages.json",
        "/images/none.png",
        "/images/../api/pages.json",
        "/static/../api/pages.json",
        "/robots.txt/../api/pages.json",
    ],
)
def test_only_pictures_styles_and_scripts_are_served(path: str) -> None:
    assert RecordedWiki().file(path) is None


@pytest.mark.parametrize("path", ["/images/Harbour_at_dawn.jpg", "/static/site.css", "/robots.txt"])
def test_pictures_styles_and_robots_are_served(path: str) -> None:
    assert RecordedWiki().file(path)
