"""Asks the wiki for its description and some pages, for `kb profile check --online`."""

import contextlib
from collections.abc import Callable, Iterator
from typing import TypeVar

from kb.core.config import value_errors
from kb.core.config.profile.check_finding import NOTE, OnlineAnswer, QuestionCost
from kb.core.config.profile.wiki import Wiki
from kb.core.context import Run
from kb.core.errors import ItemFinal
from kb.net import retry
from kb.wiki.connector.client import WikiApi, find_endpoint
from kb.wiki.connector.http_client import WikiHosts

PAGES = 5  # that are read, to try the selectors on
Result = TypeVar("Result")


class _Once(WikiHosts):
    """A wiki that is asked once: who waits for an answer would rather know now."""

    def attempt(self, call: Callable[[], Result], *, service: str | None = None) -> Result:
        """One try. Raises Unreachable or Blocked."""
        return retry.attempt(call, tries=1, service=service or "the wiki")


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """robots.txt and the front page, which names the API; then siteinfo and some pages."""
    run.settings.need("kb_contact")
    section = run.profile.section(Wiki)
    url = run.settings.kb_wiki_url or section.url
    web = _Once(run, url, section.hosts, section.seconds_between)
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
        value_errors.shown(str(general.get("sitename", url))),
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
                text = web.get(url, {}).body.decode("utf-8", "replace")
                if "wgArticleId" in text:  # else it is no page of the wiki: a challenge, say
                    yield text
