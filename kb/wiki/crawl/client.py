"""Asks MediaWiki's API (https://www.mediawiki.org/wiki/API:Query, formatversion=2).

Every request has `maxlag=5`: a wiki whose database lags answers with an error and Retry-After, and
is left alone that long. That, a contact in the User-Agent and one pace for all requests are
MediaWiki's rules for API clients (https://www.mediawiki.org/wiki/API:Etiquette). robots.txt governs
pages and images. It governs the API only where it names us (`WikiHosts.barred`), because most
wikis bar the folder of their scripts to crawlers.
"""

import re
from collections.abc import Mapping, Sequence
from html.parser import HTMLParser
from typing import Any
from urllib.parse import urljoin, urlsplit, urlunsplit

import msgspec

from kb.core.errors import FatalError, ItemFinal, Retryable
from kb.crawl.connector import Answer
from kb.crawl.limits import check_length
from kb.net import limits, retry
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.errors import Challenge, PageRefused, TransientStatus, turned_away
from kb.wiki.parse import answers

BATCH = 50
LISTED = 500  # titles of a list in one answer
# Parts of one answer, 500 entries each. A batch of pages that have more is halved.
_CONTINUED = 500
# Parts of a list, 500 titles each, beside those that the wiki's own count of pages explains: that
# count may be old, and a wiki may give fewer titles at a time.
_LISTED, _PAGES_A_PART, _MOST_PAGES = 1_000, 20, 100_000_000
_NOTICE = re.compile(rb"\b(?:Notice|Warning|Deprecated)\b")  # of PHP
_FRONT = 1_000_000  # bytes of the front page, whose head has the link
_AGAIN = ("maxlag", "readonly", "ratelimited", "internal_api_error")  # and what begins like them
_DETAILS = {
    "prop": "info|revisions|contributors|redirects|categories",
    "inprop": "url",
    "rvprop": "ids|timestamp|user|sha1|size",
    "pclimit": "500",
    "rdlimit": "500",  # what `kb profile keywords` proposes from
    "cllimit": "500",
    "clshow": "!hidden",
}
_FILES = {
    "prop": "imageinfo|extlinks",
    "iiprop": "url|size|mime|sha1|timestamp|extmetadata",
    "ellimit": "500",
}


class WikiApi:
    """Each method returns the answer to be recorded.

    Malformed answers (kb.wiki.parse.answers) are retried and never recorded. All methods raise
    Retryable or Blocked after the last try, Challenged when the API turns us away, and FatalError
    for a request that it refuses. `known`: the API has answered before.
    """

    def __init__(self, endpoint: str, web: WikiHosts, *, known: bool = False) -> None:
        self.endpoint, self._web, self._known = endpoint, web, known
        self._noticed = False
        self._loops: dict[tuple[int, int], _LoopDetector] = {}

    def site(self) -> Answer:
        """URLs, namespaces and licence of the site."""
        params = {
            "action": "query",
            "meta": "siteinfo",
            "siprop": "general|namespaces|namespacealiases|rightsinfo|statistics",
        }
        status, answer = self.ask(params)
        return Answer("site", self.endpoint, params, answer, status)

    def listing(
        self,
        number: int,
        namespace: int,
        going: dict[str, str | int],
        *,
        read: int = 0,
        pages: int = 0,
    ) -> Answer:
        """The next 500 pages of a namespace, without redirects.

        `going` is the `continue` of the previous answer, `read` how many parts came before, `pages`
        how many pages the wiki says it has. Raises Retryable when the list loops or has no end.
        """
        most = _LISTED + min(max(pages, 0), _MOST_PAGES) // _PAGES_A_PART
        check_length(f"the list of namespace {namespace}", read, most)
        params = {
            "action": "query",
            "list": "allpages",
            "apnamespace": str(namespace),
            "apfilterredir": "nonredirects",
            "aplimit": str(LISTED),
        }
        loop = self._loops.setdefault((number, namespace), _LoopDetector())
        loop.refuse_loop(going)
        status, answer = self.ask({**params, **going})
        loop.note(going, answer["query"]["allpages"])
        return Answer("titles", self.endpoint, {**params, **going, "round": number}, answer, status)

    def details(self, tag: str, *, titles: Sequence[str] = (), ids: Sequence[str] = ()) -> Answer:
        """Revision, URL, contributors, redirects and categories of up to 50 pages."""
        by = {"titles": "|".join(titles)} if titles else {"pageids": "|".join(ids)}
        # A named redirect leads to its target; a list of pages has none.
        follow = {"redirects": "1"} if titles and tag.startswith("t") else {}
        status, answer = self.ask_all({"action": "query", **by, **follow, **_DETAILS})
        return Answer("pages", self.endpoint, {**by, "round": tag}, answer, status)

    def revision(self, revision: int) -> Answer:
        """The same for one revision, when the wiki showed another one than it had listed."""
        params = {
            "action": "query",
            "revids": str(revision),
            "prop": "info|revisions",
            "inprop": "url",
            "rvprop": "ids|timestamp|user|sha1|size",
        }
        status, answer = self.ask(params)
        by = {"revids": str(revision), "round": "r"}
        return Answer("pages", self.endpoint, by, answer, status)

    def files(self, titles: list[str]) -> Answer:
        """What the wiki knows about up to 50 files; by title."""
        params = {"action": "query", "titles": "|".join(titles), **_FILES}
        status, answer = self.ask_all(params)
        return Answer("imageinfo", self.endpoint, {"titles": titles}, answer, status)

    def ask_all(self, params: Mapping[str, str | int]) -> tuple[int, dict[str, Any]]:
        """Ask one question and merge all continuations of the answer, of 100 MB at most."""
        status, first = self.ask(params)
        answer, loop, merged, read = first, _LoopDetector(), _Merged(first), 1
        while going := answer.get("continue"):
            loop.refuse_loop(going)
            check_length("the wiki's answer", read, _CONTINUED)
            status, answer = self.ask({**params, **going})
            loop.note(going)
            merged.merge(answer)
            read += 1
        first.pop("continue", None)
        return status, first

    def ask(self, params: Mapping[str, str | int]) -> tuple[int, dict[str, Any]]:
        """Ask one question; returns status and answer."""
        try:
            answer = self._web.attempt(lambda: self._once(params))
        except Challenge as error:
            raise turned_away(error.reason) from None
        self._known = True
        return answer

    def _once(self, params: Mapping[str, str | int]) -> tuple[int, dict[str, Any]]:
        try:
            answer = self._web.get(
                self.endpoint, {**params, "format": "json", "formatversion": "2", "maxlag": "5"}
            )
        except TransientStatus as error:
            raise Retryable(error.reason) from None
        except ItemFinal as error:
            if self._known or isinstance(error, PageRefused):
                raise turned_away(f"the wiki's API turns us away ({error})") from None
            raise FatalError(
                f"the wiki's API at {self.endpoint} does not answer: {error}",
                hint="open the URL in a browser",
            ) from None
        content = answer.content.removeprefix(b"\xef\xbb\xbf").lstrip()
        try:
            value = msgspec.json.decode(self._after_notice(content))
        except (msgspec.DecodeError, RecursionError):
            what = answers.quoted(answer.content[:1000].decode("utf-8", "replace"))
            kind = Challenge if content[:1] == b"<" else Retryable
            raise kind(f"{self.endpoint} returns {what} instead of JSON") from None
        after = retry.retry_after(answer.headers.get("Retry-After"))
        refusal = value.get("error") if isinstance(value, dict) else None
        if isinstance(refusal, dict) and refusal:
            code = str(refusal.get("code"))
            if code.startswith(_AGAIN):
                raise Retryable(code, after=after)
            if code in ("blocked", "autoblocked", "readapidenied"):
                raise turned_away(f"the wiki's API refuses: {refusal.get('info', code)}")
            raise FatalError(
                f"the wiki's API refuses {params.get('action')}: {refusal.get('info', code)}"
            )
        query = value.get("query") if isinstance(value, dict) else None
        if isinstance(query, dict) and isinstance(query.get("pages"), dict):
            raise FatalError(
                f"the wiki's API at {self.endpoint} answers in the form of MediaWiki before 1.25,"
                " which can't be read",
                hint="ask the wiki's operators for an update",
            )
        if wrong := answers.problem(params, value):
            raise Retryable(f"{wrong} ({self.endpoint})", after=after)
        return answer.status_code, value

    def _after_notice(self, content: bytes) -> bytes:
        """The JSON behind what a misconfigured PHP writes before it; the first notice is shown."""
        start = content.find(b"{")
        if start <= 0 or not _NOTICE.search(content[:start]):
            return content
        if not self._noticed:
            self._noticed = True
            text = content[: min(start, _FRONT // 100)].decode("utf-8", "replace")
            notice = answers.quoted(re.sub(r"<[^<>]*>", "", text))
            self._web.run.progress.say(f"{self.endpoint} writes {notice} before its answers")
        return content[start:]


class _LoopDetector:
    """Detects a list whose continuations, or consecutive parts, repeat."""

    def __init__(self) -> None:
        self._seen: set[bytes] = set()
        self._last: Sequence[Any] = ()

    def refuse_loop(self, going: Mapping[str, str | int], entries: Sequence[Any] = ()) -> None:
        """Raises Retryable for a step that was answered before, or with the same entries as the
        step before.
        """
        if _step_key(going) in self._seen or (entries and entries == self._last):
            step = answers.quoted(_step_key(going).decode())
            raise Retryable(f"the wiki's API loops: it continues again at {step}")

    def note(self, going: Mapping[str, str | int], entries: Sequence[Any] = ()) -> None:
        """Record an answered step. Raises as `refuse_loop`."""
        self.refuse_loop(going, entries)
        self._seen.add(_step_key(going))
        self._last = entries


def _step_key(going: Mapping[str, str | int]) -> bytes:
    return msgspec.json.encode(going, order="sorted")


class _Merged:
    """An answer that takes in its continuations, page by page: lists grow by what is new."""

    def __init__(self, first: dict[str, Any]) -> None:
        self._pages = first.setdefault("query", {}).setdefault("pages", [])
        self._known: dict[Any, dict[str, Any]] = {}
        self._entries: dict[tuple[Any, str], set[bytes]] = {}
        self._size = 0
        for page in self._pages:
            self._known[_key(page)] = page

    def merge(self, more: dict[str, Any]) -> None:
        """Merge another part. Raises Retryable when the whole has too many bytes."""
        for page in more.get("query", {}).get("pages", []):
            known = self._known.setdefault(_key(page), page)
            if known is page:
                self._pages.append(page)
                self._count(msgspec.json.encode(page))
                continue
            for name, value in page.items():
                if isinstance(value, list) and isinstance(known.get(name), list):
                    self._extend(known[name], (_key(page), name), value)
                elif name not in known:
                    known[name] = value
                    self._count(msgspec.json.encode(value))

    def _extend(self, entries: list[Any], place: tuple[Any, str], more: list[Any]) -> None:
        seen = self._entries.get(place)
        if seen is None:
            seen = self._entries[place] = {*map(msgspec.json.encode, entries)}
        for entry in more:
            text = msgspec.json.encode(entry)
            if text not in seen:
                seen.add(text)
                entries.append(entry)
                self._count(text)

    def _count(self, text: bytes) -> None:
        self._size += len(text)
        if self._size > limits.ANSWER_BYTES:
            raise Retryable("the wiki's answer has too many parts")


def _key(page: dict[str, Any]) -> Any:
    return page.get("pageid", page.get("title"))


class _FrontPage(HTMLParser):
    """`href` of the EditURI link; `unlisted` when the page asks not to be indexed.

    A wiki's front page never does that; challenge pages do (Anubis, Cloudflare).
    """

    def __init__(self) -> None:
        super().__init__()
        self.href: str | None = None
        self.unlisted = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if tag == "link" and given.get("rel", "").lower() == "edituri":
            self.href = self.href or given.get("href")
        if tag == "meta" and given.get("name", "").lower() == "robots":
            self.unlisted = "noindex" in given.get("content", "").lower()


def find_endpoint(web: WikiHosts, url: str, *, known: bool = False) -> str:
    """Find the URL of `api.php` by the front page's EditURI link. Raises FatalError, Challenged.

    `known`: the wiki had one before, so a front page without it is a challenge.
    """
    web.barred(f"{url}/")
    try:
        page = web.attempt(lambda: web.get(f"{url}/", {}), service="the wiki")
    except ItemFinal as error:
        if known or isinstance(error, PageRefused):
            raise turned_away(f"{url} turns us away ({error})") from None
        raise FatalError(f"{url} does not answer as a wiki: {error}") from None
    front = _FrontPage()
    front.feed(page.content[:_FRONT].decode("utf-8", "replace"))
    if not front.href and (known or front.unlisted or web.foreign_robots):
        raise turned_away(f"{url} shows a page that is not the wiki's, as a challenge does")
    if not front.href:
        raise FatalError(
            f"{url} has no EditURI link: it is not a MediaWiki, or answers with a challenge page",
            hint="set KB_WIKI_URL, or wiki.url in the profile, to the root of a MediaWiki",
        )
    parts = urlsplit(urljoin(page.url, front.href))
    if parts.hostname != urlsplit(page.url).hostname:
        raise FatalError(f"the EditURI link of {url} points to another host, {parts.hostname}")
    return urlunsplit((parts.scheme, parts.netloc, parts.path, "", ""))
