"""Discovery by MediaWiki's API (https://www.mediawiki.org/wiki/API:Query, formatversion=2).

Every request says `maxlag=5`: a wiki whose database lags answers with an error and Retry-After,
and is left alone that long. That, the contact in the User-Agent and one pace for all requests are what
MediaWiki asks of API clients (https://www.mediawiki.org/wiki/API:Etiquette). robots.txt tells crawlers
which pages to leave alone, and most wikis bar the folder of their scripts there; so it rules pages and
pictures, and the API only where it names us (`Web.barred`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from typing import Any
from urllib.parse import urljoin, urlsplit, urlunsplit

import msgspec

from kb.core.errors import Blocked, FatalError, ItemFinal, Retryable, Unreachable
from kb.wiki import answers
from kb.wiki.web import Web

BATCH = 50
_AGAIN = ("maxlag", "readonly", "ratelimited", "internal_api_error")  # and what begins like them
_DETAILS = {
    "prop": "info|revisions|contributors",
    "inprop": "url",
    "rvprop": "ids|timestamp|user|sha1|size",
    "pclimit": "500",
}
_FILES = {
    "prop": "imageinfo|extlinks",
    "iiprop": "url|size|mime|sha1|timestamp|extmetadata",
    "ellimit": "500",
}

Record = Callable[[str, str, dict[str, Any], int, Any], Any]


class Api:
    """`record(kind, endpoint, params, status, answer)` keeps an answer before it is used.

    What is no answer to the question (kb.wiki.answers) is tried again and never kept.
    """

    def __init__(self, endpoint: str, web: Web, record: Record) -> None:
        self.endpoint, self._web, self._record = endpoint, web, record

    def site(self) -> dict[str, Any]:
        """Addresses, namespaces and licence of the site."""
        params = {
            "action": "query",
            "meta": "siteinfo",
            "siprop": "general|namespaces|rightsinfo|statistics",
        }
        status, answer = self.ask(params)
        self._record("site", self.endpoint, params, status, answer)
        return answer["query"]

    def listing(self, number: int, namespace: int, start: dict[str, str]) -> Iterator[int]:
        """All pages of a namespace without redirects, 500 a call, from `start` on; how many each call gave.

        Raises Unreachable when the list goes in a circle.
        """
        params = {
            "action": "query",
            "list": "allpages",
            "apnamespace": str(namespace),
            "apfilterredir": "nonredirects",
            "aplimit": "500",
        }
        circle = _Circle(start)
        going: dict[str, str] | None = start
        while going is not None:
            status, answer = self.ask({**params, **going})
            self._record(
                "titles", self.endpoint, {**params, **going, "round": number}, status, answer
            )
            yield len(answer["query"]["allpages"])
            going = answer.get("continue") or None
            circle.check(going, answer["query"]["allpages"])

    def details(self, tag: str, *, titles: list[str] = (), ids: list[str] = ()) -> None:  # type: ignore[assignment]
        """Revision, address and contributors of up to 50 pages."""
        by = {"titles": "|".join(titles)} if titles else {"pageids": "|".join(ids)}
        status, answer = self.whole({"action": "query", **by, **_DETAILS})
        self._record("pages", self.endpoint, {**by, "round": tag}, status, answer)

    def revision(self, revision: int) -> None:
        """The same for one revision, when the wiki showed another than it had named."""
        params = {
            "action": "query",
            "revids": str(revision),
            "prop": "info|revisions",
            "inprop": "url",
            "rvprop": "ids|timestamp|user|sha1|size",
        }
        status, answer = self.ask(params)
        self._record(
            "pages", self.endpoint, {"revids": str(revision), "round": "r"}, status, answer
        )

    def files(self, titles: list[str]) -> dict[str, dict[str, Any]]:
        """What the wiki knows about up to 50 files, by the title that was asked for."""
        params = {"action": "query", "titles": "|".join(titles), **_FILES}
        status, answer = self.whole(params)
        self._record("imageinfo", self.endpoint, {"titles": titles}, status, answer)
        query = answer.get("query", {})
        names = {change["from"]: change["to"] for change in query.get("normalized", [])}
        pages = {page.get("title"): page for page in query.get("pages", [])}
        return {
            title: pages[names.get(title, title)]
            for title in titles
            if names.get(title, title) in pages
        }

    def whole(self, params: dict[str, str]) -> tuple[int, dict[str, Any]]:
        """An answer with all its continuations joined."""
        status, first = self.ask(params)
        answer, circle = first, _Circle({})
        while going := answer.get("continue"):
            circle.check(going)
            status, answer = self.ask({**params, **going})
            _join(first, answer)
        first.pop("continue", None)
        return status, first

    def ask(self, params: dict[str, str]) -> tuple[int, dict[str, Any]]:
        """One request. Raises Unreachable or Blocked after all tries, FatalError for a request the API refuses."""
        return self._web.attempt(lambda: self._once(params))

    def _once(self, params: dict[str, str]) -> tuple[int, dict[str, Any]]:
        try:
            answer = self._web.get(
                self.endpoint, {**params, "format": "json", "formatversion": "2", "maxlag": "5"}
            )
        except ItemFinal as error:
            if error.reason in ("http_401", "http_403"):
                raise Blocked(
                    f"the wiki's API refuses us ({error.reason})",
                    hint="wait and run the same command again",
                ) from None
            raise FatalError(
                f"the wiki's API at {self.endpoint} does not answer: {error}",
                hint="look at the address in a browser",
            ) from None
        try:
            value = msgspec.json.decode(answer.body)
        except msgspec.DecodeError:
            what = answers.quoted(answer.body[:1000].decode("utf-8", "replace"))
            raise Retryable(f"{self.endpoint} gives no JSON but {what}") from None
        error = value.get("error") if isinstance(value, dict) else None
        if isinstance(error, dict) and error:
            code = str(error.get("code"))
            if code.startswith(_AGAIN):
                raise Retryable(code, after=answer.after)
            if code in ("blocked", "autoblocked", "readapidenied"):
                raise Blocked(f"the wiki's API refuses: {error.get('info', code)}")
            raise FatalError(
                f"the wiki's API refuses {params.get('action')}: {error.get('info', code)}"
            )
        if wrong := answers.problem(params, value):
            raise Retryable(f"{wrong} ({self.endpoint})", after=answer.after)
        return answer.status, value


class _Circle:
    """Finds that a list which is continued step by step goes in a circle. `start` is the first step."""

    def __init__(self, start: dict[str, str]) -> None:
        self._seen, self._last = {_step(start)}, None

    def check(self, going: dict[str, str] | None, entries: list[Any] | None = None) -> None:
        """Take the next step and what the last one gave. Raises Unreachable: such a list has no end."""
        if going is not None and (
            _step(going) in self._seen or (entries and entries == self._last)
        ):
            raise Unreachable(
                f"the wiki's API goes in a circle: it says again to continue at {answers.quoted(_step(going))}",
                hint="nothing that was read is lost; run the same command later, or name pages with --titles",
            )
        self._seen |= {_step(going)} if going else set()
        self._last = entries


def _step(going: dict[str, str]) -> str:
    return msgspec.json.encode(going, order="sorted").decode()


def _join(first: dict[str, Any], more: dict[str, Any]) -> None:
    """Take the lists of a continued answer into the first one, page by page."""
    pages = {
        page.get("pageid", page.get("title")): page
        for page in first.get("query", {}).get("pages", [])
    }
    for page in more.get("query", {}).get("pages", []):
        known = pages.get(page.get("pageid", page.get("title")))
        if known is None:
            first["query"]["pages"].append(page)
            continue
        for name, value in page.items():
            if isinstance(value, list) and isinstance(known.get(name), list):
                known[name] += [entry for entry in value if entry not in known[name]]
            else:
                known.setdefault(name, value)


class _Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        held = dict(attrs)
        if tag == "link" and (held.get("rel") or "").lower() == "edituri" and held.get("href"):
            self.found = self.found or held["href"]


def find_endpoint(web: Web, url: str) -> str:
    """The address of `api.php` by the EditURI link of the wiki's front page. Raises FatalError, Blocked."""
    web.barred(f"{url}/")
    try:
        page = web.attempt(lambda: web.get(f"{url}/", {}))
    except ItemFinal as error:
        if error.reason in ("http_401", "http_403"):
            raise Blocked(
                f"the wiki refuses us ({error.reason})", hint="wait and run the same command again"
            ) from None
        raise FatalError(f"{url} does not answer as a wiki: {error}") from None
    links = _Links()
    links.feed(page.body.decode("utf-8", "replace"))
    if not links.found:
        raise FatalError(
            f"{url} has no EditURI link, so its API is not known",
            hint="give the root of a MediaWiki as KB_WIKI_URL or wiki.url in the profile",
        )
    found = urlsplit(urljoin(page.url, links.found))
    if found.hostname != urlsplit(page.url).hostname:
        raise FatalError(f"the EditURI link of {url} leads to another host, {found.hostname}")
    return urlunsplit((found.scheme, found.netloc, found.path, "", ""))
