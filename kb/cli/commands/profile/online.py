"""`kb profile check --online`: one question to each service, by the crawls' own clients.

Only what a crawl would ask first: a search for channels, the wiki's siteinfo with a few pages to
try the selectors on, the subreddit. Nothing is stored; a question is asked once and not again.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from kb.core import clock, wording
from kb.core.errors import (
    CredentialRefused,
    Interrupted,
    ItemFinal,
    KbError,
    MissingCredential,
    Retryable,
    SettingError,
    Stopped,
)
from kb.core.profile.finding import ERROR, NOTE, WARNING, Finding
from kb.core.profile.reddit import RedditSection
from kb.core.profile.wiki import Wiki
from kb.core.profile.youtube import YouTubeSection
from kb.net import retry
from kb.reddit.client import Client
from kb.store.frontier import Frontier
from kb.wiki.api import WikiApi, find_endpoint
from kb.wiki.web import WikiHosts
from kb.youtube.api import YouTubeApi

if TYPE_CHECKING:
    from kb.core.context import Run

Result = TypeVar("Result")
PAGES = 5  # of the wiki that are read, to try the selectors on
UNREACHABLE, REFUSED, WRONG = 3, 1, 2  # exit codes of what a service answers


class ServiceCheck(NamedTuple):
    """What a service said: the finding, what it cost, and the exit code that follows.

    `pages` are some of the wiki's pages as HTML, to try the selectors on.
    """

    source: str
    finding: Finding
    requests: int = 0
    units: int = 0
    code: int = 0
    pages: tuple[str, ...] = ()


class Cost:
    """Requests and quota units of one question, and the pages that it brought."""

    def __init__(self) -> None:
        self.requests = self.units = 0
        self.pages: list[str] = []

    def said(self) -> str:
        """What was spent, for a person."""
        asked = "1 request" if self.requests == 1 else f"{self.requests} requests"
        return f"cost: {asked}, 1 search unit" if self.units else f"cost: {asked}"


def ask(run: Run) -> Iterator[ServiceCheck]:
    """One answer for each source of the profile. Raises Interrupted only."""
    questions = {"youtube": _youtube, "wiki": _wiki, "reddit": _reddit}
    for source, question in questions.items():
        if getattr(run.profile, source) is None:
            continue
        cost = Cost()
        level, key, what, mend, code = _tried(partial(question, run, cost), source)
        finding = Finding(level, f"online: {source}", 0, key, f"{what} ({cost.said()})", mend)
        yield ServiceCheck(source, finding, cost.requests, cost.units, code, tuple(cost.pages))


Said = tuple[str, str, str, str, int]


def _tried(question: Callable[[], Said], source: str) -> Said:
    """The answer, or what an error means for the profile."""
    try:
        return question()
    except (MissingCredential, SettingError) as error:
        return WARNING, "", f"not asked: {error}", error.hint, 0
    except (Retryable, Stopped) as error:
        if isinstance(error, Interrupted):
            raise
        hint = error.hint or "run the same command later"
        return WARNING, "", f"no answer: {error}", hint, UNREACHABLE
    except KbError as error:
        code = REFUSED if isinstance(error, CredentialRefused) else WRONG
        return ERROR, "", str(error), error.hint, code


def _youtube(run: Run, cost: Cost) -> Said:
    """One channel search: 1 of the search bucket's units."""
    section = run.profile.section(YouTubeSection)
    words = section.keywords[0]
    with tempfile.TemporaryDirectory() as place:
        ledger = Frontier(Path(place) / "ledger.sqlite")
        try:
            once = section.model_copy(update={"max_tries": 1})
            api = YouTubeApi(run, once, _Alone(run, ledger), lane="api")
            cost.requests = cost.units = 1
            answer = api.search(q=words, type="channel", part="snippet", maxResults=5)
            api.close()
        finally:
            ledger.close()
    titles = [_title(one) for one in answer.get("items", [])]
    searched = f"a search for {wording.shown(words)}"
    if not titles:
        mend = "search for what channels of the domain call themselves"
        return ERROR, "youtube.keywords", f"{searched} finds no channel", mend, WRONG
    shown = ", ".join(titles[:3])
    return NOTE, "youtube.keywords", f"{searched} finds channels such as {shown}", "", 0


@dataclass
class _Alone:
    """What the Data API's client needs of an open data root, without one."""

    run: Run
    frontier: Frontier
    gone: set[str] = field(default_factory=set)

    def probing(self, lane: str) -> bool:
        """Nobody was turned away before."""
        return False

    def check(self, lane: str) -> None:
        """No other thread asks."""

    def sleep(self, lane: str, seconds: float) -> None:
        """Between two tries."""
        clock.sleep(seconds)


def _title(item: dict[str, Any]) -> str:
    return wording.shown(str(item.get("snippet", {}).get("title", "")))


class _Once(WikiHosts):
    """A wiki that is asked once: who waits for an answer would rather know now."""

    def attempt(self, call: Callable[[], Result], *, service: str | None = None) -> Result:
        """One try. Raises Unreachable or Blocked."""
        return retry.attempt(call, tries=1, service=service or "the wiki")


def _wiki(run: Run, cost: Cost) -> Said:
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
    said = [wording.shown(str(general.get("sitename", url))), str(general.get("generator", ""))]
    said += [f"{pages:,} pages"] if isinstance(pages, int) else []
    said += [f"licence: {rights.get('text') or rights.get('url') or 'none named'}"]
    return NOTE, "wiki.url", ", ".join(filter(None, said)), "", 0


def _some_pages(api: WikiApi, web: WikiHosts, namespace: int) -> Iterator[str]:
    """Pages of the wiki, spread evenly over the beginning of its list."""
    listed = api.listing(1, namespace, {}).response["query"]["allpages"]
    titles = [page["title"] for page in listed[:: max(1, -(-len(listed) // PAGES))]]
    if not titles:
        return
    told = api.details("", titles=titles).response["query"].get("pages", [])
    for url in sorted(page["fullurl"] for page in told if isinstance(page.get("fullurl"), str)):
        with contextlib.suppress(ItemFinal):
            if web.allowed(url):
                text = web.get(url, {}).body.decode("utf-8", "replace")
                if "wgArticleId" in text:  # else it is no page of the wiki: a challenge, say
                    yield text


def _reddit(run: Run, cost: Cost) -> Said:
    """The subreddit's own page; the token before it is a request as well."""
    section = run.profile.section(RedditSection)

    def spend(endpoint: str, units: int) -> Callable[[str], None]:
        cost.requests += 1
        return lambda outcome: None

    client = Client(
        run.settings, spend, requests_per_minute=section.requests_per_minute, max_tries=1
    )
    name = section.subreddit
    try:
        about = client.get(f"r/{name}/about/", {"raw_json": 1}).get("data", {})
    except ItemFinal as fact:
        why = {
            "redirect": "there is no subreddit of that name",
            "not_found": "it was banned, or there is none of that name",
            "forbidden": "it is private or quarantined",
        }.get(fact.reason, fact.reason)
        return ERROR, "reddit.subreddit", f"r/{name} can't be read", why, WRONG
    said = f"r/{about.get('display_name', name)}"
    if isinstance(about.get("subscribers"), int):
        said += f", {about['subscribers']:,} subscribers"
    if about.get("over18"):
        mend = "its posts are rejected at the stage nsfw"
        return WARNING, "reddit.subreddit", f"{said}, for adults only", mend, 0
    return NOTE, "reddit.subreddit", said, "", 0
