"""Counts what a profile's CSS selectors match in pages, in the browser that a crawl uses.

Pages are only parsed: no script runs and nothing is loaded.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from kb.core.config.profile.wiki import Markup
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.browser.process_guard import Guard

_SECONDS = 60.0
# Selectors that apply inside the matches of another one.
_INSIDE = {
    "fact": "regions.infobox",
    "fact_subject": "regions.infobox",
    "fact_field": "fact",
    "fact_value": "fact",
    "slot": "recipe",
    "slot_row": "recipe",
    "slot_output": "recipe",
}
_NO_SELECTORS = ("regions", "units", "item", "animation_active")
_COUNT = """
const page = new DOMParser().parseFromString(arguments[0], "text/html");
return arguments[1].map(([selector, around]) => {
  try { document.createDocumentFragment().querySelector(selector); } catch { return null; }
  try {
    const places = around ? [...page.querySelectorAll(around)] : [page];
    return places.reduce((sum, place) => sum + place.querySelectorAll(selector).length, 0);
  } catch { return 0; }
});
"""


class SelectorMatches(NamedTuple):
    """`matches` in all pages together; None when the browser rejects the selector."""

    key: str  # as in `wiki.markup.slot`
    selector: str
    matches: int | None


def selectors_of(markup: Markup) -> dict[str, str]:
    """The selectors of a profile by their keys below `wiki.markup`."""
    names = [name for name in Markup.model_fields if name not in _NO_SELECTORS]
    return {name: getattr(markup, name) for name in names} | {
        f"regions.{name}": selector for name, selector in markup.regions.items()
    }


def count_matches(markup: Markup, pages: Iterable[str]) -> list[SelectorMatches]:
    """How often each selector matches in pages given as HTML. Raises MissingExtra, Retryable."""
    named = selectors_of(markup)
    asked = [[selector, named.get(_INSIDE.get(key, ""))] for key, selector in named.items()]
    sums: list[int | None] = [0] * len(asked)
    with _browser() as browser:
        for html in pages:
            counts = browser.script(_COUNT, html, asked)
            sums = [
                None if one is None or more is None else one + more
                for one, more in zip(sums, counts, strict=True)
            ]
    return [
        SelectorMatches(f"wiki.markup.{key}", selector, matches)
        for (key, selector), matches in zip(named.items(), sums, strict=True)
    ]


@contextmanager
def _browser() -> Iterator[Browser]:
    """A browser without access to any host."""
    programs, watcher = chromium.find(), Guard()
    try:
        browser = Browser(
            programs,
            watcher,
            hosts=(),
            origins=(),
            user_agent="lorecrawl",
            viewport=(1280, 1024),
            page_seconds=_SECONDS,
        )
        try:
            yield browser
        finally:
            browser.end()
    finally:
        watcher.close()
