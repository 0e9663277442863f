"""Checks a profile against its wiki: the wiki's description and some pages for
`kb profile check --online`, and what the profile's CSS selectors match in pages.

Selectors are tried in the browser that a crawl uses. Pages are only parsed: no script runs and
nothing is loaded.
"""

import contextlib
from collections.abc import Iterable, Iterator

from kb.core import terminal
from kb.core.config.section import NOTE, OnlineAnswer, QuestionCost
from kb.core.context import Run
from kb.core.errors import ItemFinal
from kb.wiki.browser import chromium
from kb.wiki.browser.browser import Browser
from kb.wiki.crawl.client import WikiApi, find_endpoint
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.section import Markup, WikiSection

PAGES = 5  # that are read, to try the selectors on


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """robots.txt and the front page, which names the API; then siteinfo and some pages."""
    run.settings.need("kb_contact")
    section = run.profile.section(WikiSection)
    url = run.settings.kb_wiki_url or section.url
    # Users who wait for a check want no retries.
    web = WikiHosts(run, url, section.hosts, section.seconds_between, tries=1)
    try:
        web.read_robots()
        api = WikiApi(find_endpoint(web, url), web)
        site = api.site().response["query"]
        cost.pages = list(_some_pages(api, web, section.namespaces[0] if section.namespaces else 0))
    finally:
        cost.requests = web.requests
    general, rights = site.get("general", {}), site.get("rightsinfo", {})
    pages = site.get("statistics", {}).get("articles")
    facts = [
        terminal.shown(str(general.get("sitename", url))),
        str(general.get("generator", "")),
    ]
    facts += [f"{pages:,} pages"] if isinstance(pages, int) else []
    facts += [f"licence: {rights.get('text') or rights.get('url') or 'none named'}"]
    return OnlineAnswer(NOTE, "wiki.url", ", ".join(filter(None, facts)))


def _some_pages(api: WikiApi, web: WikiHosts, namespace: int) -> Iterator[str]:
    """Pages of the wiki, spread evenly over the beginning of its list."""
    listed = api.listing(1, namespace, {}).response["query"]["allpages"]
    titles = [page["title"] for page in listed[:: max(1, -(-len(listed) // PAGES))]]
    if not titles:
        return
    described = api.details("", titles=titles).response["query"].get("pages", [])
    for url in sorted(
        page["fullurl"] for page in described if isinstance(page.get("fullurl"), str)
    ):
        with contextlib.suppress(ItemFinal):
            if web.allowed(url):
                text = web.get(url, {}).content.decode("utf-8", "replace")
                if "wgArticleId" in text:  # else it is no page of the wiki: a challenge, say
                    yield text


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
_NO_SELECTORS = ("regions", "units", "item", "stations", "animation_active")
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


def selectors_of(markup: Markup) -> dict[str, str]:
    """The selectors that a profile has, by their keys below `wiki.markup`."""
    names = [name for name in Markup.model_fields if name not in _NO_SELECTORS]
    every = {name: getattr(markup, name) for name in names} | {
        f"regions.{name}": selector for name, selector in markup.regions.items()
    }
    return {key: selector for key, selector in every.items() if selector}


def count_matches(markup: Markup, pages: Iterable[str]) -> dict[str, int | None]:
    """How often each selector (by its key, as `wiki.markup.slot`) matches in pages given as HTML;
    None when the browser rejects it. Raises MissingExtra, Retryable.
    """
    named = selectors_of(markup)
    asked = [[selector, named.get(_INSIDE.get(key, ""))] for key, selector in named.items()]
    with contextlib.ExitStack() as stack:
        browser = Browser(
            chromium.find_programs(),
            hosts=(),
            origins=(),
            user_agent="lorecrawl",
            viewport=(1280, 1024),
            page_seconds=_SECONDS,
        )
        stack.callback(browser.end)
        counts = [browser.script(_COUNT, html, asked) for html in pages]
    counted = zip(*counts, strict=True) if counts else [(0,)] * len(asked)
    return {
        f"wiki.markup.{key}": None if None in matches else sum(matches)
        for key, matches in zip(named, counted, strict=True)
    }
