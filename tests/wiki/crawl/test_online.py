"""Selectors are tried by the browser that a crawl uses."""

import pytest

from kb.core.config.profile import load_profile
from kb.wiki.crawl.online import count_matches, selectors_of
from kb.wiki.section import selector_problem

MARKUP = load_profile("minecraft").wiki.markup


def test_matches_are_counted_over_pages_and_inside_of_what_holds_them(programs):
    box = "<table class=infobox><tr><th>Mass<td>2 kg</table>"
    grid = '<div class=mcui><span class="invslot"></span></div><span class="invslot"></span>'
    markup = MARKUP.model_copy(update={"quantity": "b:no-such-thing", "root": ".elsewhere"})
    found = {
        key.removeprefix("wiki.markup."): matches
        for key, matches in count_matches(
            markup, [box + grid, f"<p>{grid}</p>", "<p>nothing"]
        ).items()
    }
    assert found.keys() == selectors_of(markup).keys()
    names = ("fact", "fact_field", "fact_value", "recipe", "slot", "root", "quantity")
    assert [found[name] for name in names] == [1, 1, 1, 2, 2, 0, None]


@pytest.mark.parametrize("selector", [*selectors_of(MARKUP).values(), ':not([a="("]) > ::before'])
def test_selectors_are_taken(selector):
    assert selector_problem(selector) is None


@pytest.mark.parametrize(
    "selector",
    [
        "",
        "..x",
        ".infobox[",
        "tr >",
        "> td",
        ".x,, .y",
        "#",
        ":not(.c",
        "[href='x]",
        "{x}",
        "a $ b",
    ],
)
def test_what_is_no_selector_is_refused(selector):
    assert selector_problem(selector) is not None
