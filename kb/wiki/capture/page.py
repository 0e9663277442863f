"""Captures one page as a reader sees it: load, settle, extract, take the screenshot."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kb.core import clock
from kb.core.errors import ItemFinal, Retryable
from kb.net import retry
from kb.wiki.browser.browser import Browser
from kb.wiki.capture import screenshot
from kb.wiki.errors import (
    BrowserError,
    Challenge,
    NoResponse,
    OtherPage,
    PageMoved,
    ServerFault,
    of_status,
)

_SETTLE = "return await window.__kb.settle(arguments[0]);"
_AGAIN = "window.__kb.again(arguments[0]);"
_FREEZE = "return await window.__kb.freeze(arguments[0]);"
_MEASURE = (
    "return [Math.max(document.documentElement.scrollWidth, document.documentElement.clientWidth),"
    " Math.max(document.documentElement.scrollHeight, document.documentElement.clientHeight)];"
)
_HTML = "return ('<!DOCTYPE html>\\n' + document.documentElement.outerHTML).toWellFormed();"
# Style sheets and scripts determine the layout; images are retried while settling.
_BROKEN = """
return performance.getEntriesByType("resource")
  .filter((e) => ["link", "script", "css"].includes(e.initiatorType)
    && e.name.startsWith(location.origin)
    && (e.responseStatus >= 500 || e.responseStatus === 429
      || e.responseStatus === 0 && e.transferSize === 0 && e.decodedBodySize === 0
        && e.duration > 0))
  .map((e) => e.name);
"""
_IDENTITY = "return window.__kb ? window.__kb.identity() : {};"
_STATUS = """
const entry = performance.getEntriesByType("navigation")[0];
return [location.href, entry ? entry.responseStatus : 0];
"""


@cache
def page_script(name: str) -> str:
    """The text of extract.js or settle.js."""
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


@dataclass
class Captured:
    """A captured page. `sprites` are the cropped pixels (PNG bytes) by element id."""

    extraction: dict[str, Any]
    html: str
    settled: bool
    sprites: dict[int, bytes]


@dataclass(frozen=True)
class DocumentResponse:
    """The last response of a URL: `status` is 0 when there was none, or when it was cut off.

    `after` is its Retry-After in seconds. `barred`: the browser itself blocked the request.
    """

    status: int
    after: float | None = None
    barred: bool = False

    @property
    def may_come_back(self) -> bool:
        """Whether a retry can help: not for absent or refused URLs."""
        return not self.barred and (self.status in (0, 429) or self.status >= 500)


class PageTraffic:
    """The responses since the page was opened, by URL, from Chromium's performance log; `take_in`
    updates them. Scripts of the page see neither Retry-After nor why an image failed.
    """

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._addresses: dict[str, str] = {}
        self._failed: set[str] = set()
        self._frame: str | None = None  # of the page itself
        self._document: str | None = None  # the newest request for it
        self.served: dict[str, DocumentResponse] = {}
        browser.record()  # forget the pages before

    def take_in(self) -> None:
        """Process the log entries since the last call. Raises Retryable."""
        for entry in self._browser.record():
            event = json.loads(entry["message"])["message"]
            self._note(event["method"], event["params"])

    def _note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self._addresses[params["requestId"]] = _bare(params["request"]["url"])
            if params.get("type") == "Document":
                self._frame = self._frame or params.get("frameId")
                if params.get("frameId") == self._frame:
                    self._document = params["requestId"]
        elif method == "Network.responseReceived":
            answer = params["response"]
            headers = {name.lower(): value for name, value in answer.get("headers", {}).items()}
            self.served[_bare(answer["url"])] = DocumentResponse(
                int(answer["status"]),
                retry.retry_after(headers.get("retry-after"), headers.get("date")),
            )
        elif method == "Network.loadingFailed":
            self._failed.add(params["requestId"])
            url = self._addresses.get(params["requestId"])
            # An error page's body is not wanted by an image: the status before it says more.
            if url is not None and (url not in self.served or self.served[url].status < 400):
                self.served[url] = DocumentResponse(0, barred="blockedReason" in params)

    @property
    def cut_off(self) -> bool:
        """Whether the page's own document was cut off: Chromium shows what had arrived."""
        return self._document in self._failed

    def document(self) -> str | None:
        """The text of the page's own document; None when the browser no longer has it."""
        try:
            answer = self._browser.devtools(
                "Network.getResponseBody", {"requestId": self._document}
            )
        except Retryable:
            return None
        return None if answer["base64Encoded"] else str(answer["body"])

    @property
    def landed(self) -> DocumentResponse | None:
        """The last response of the page's own document, behind redirects; None without one."""
        return self.served.get(self._addresses.get(self._document or "", ""))

    def response_of(self, url: str) -> DocumentResponse | None:
        """The last response of a URL; None when it was not requested."""
        return self.served.get(_bare(url))


def _bare(url: str) -> str:
    return url.split("#", 1)[0]


def wait_retry_after(after: float | None, within: float) -> bool:
    """Wait for Retry-After only, without a pace of our own. See `capture`."""
    if (after or 0.0) > within:
        return False
    clock.sleep(after or 0.0)
    return True


def capture(
    browser: Browser,
    url: str,
    shot: Path,
    rules: dict[str, Any],
    *,
    max_height: int,
    page_id: int | None = None,
    strict: bool = True,
    patience: int = 1,
    turn: Callable[[float | None, float], bool] = wait_retry_after,
) -> Captured:
    """Load `url` and write its screenshot to `shot`.

    With `page_id`, the document must name it and end with `</html>`, as MediaWiki's do. `strict`
    fails when the end is missing, or a style sheet or script was not served; the last try accepts
    the page as it is. `turn(after, within)` waits until another request may be sent, at least
    `after` seconds, and returns False when that takes longer than `within` seconds. A page that
    moves while its picture is taken is looked at `patience` times, and must stand still that much
    longer before. Raises Retryable (another try may succeed) or ItemFinal (it will not).
    """
    network = PageTraffic(browser)
    still = rules["still_seconds"] * patience
    rules = {**rules, "still_seconds": still, "patience": patience}
    with _explained(browser, network, url):
        browser.go(url)
        network.take_in()
        _check_document(browser, network, url)
        if page_id is not None:
            _check_identity(browser.script(_IDENTITY), page_id)
            text = network.document() if strict else None
            if text is not None and "</html" not in text[-1000:].lower():
                raise ServerFault("cut_off")
        if strict and (broken := browser.script(_BROKEN)):
            waits = [
                served.after or 0.0
                for address in broken
                if (served := network.response_of(address))
            ]
            raise ServerFault("resource_failed", after=max(waits, default=0.0) or None)
    capture_once = partial(
        _capture_once, browser, network, url, shot, rules, max_height, page_id, turn
    )
    for _ in range(patience - 1):
        try:
            return capture_once()
        except PageMoved:
            # What moved because its picture was taken stands still when it is taken again.
            browser.allow(browser.page_seconds)
    return capture_once()


@contextmanager
def _explained(browser: Browser, network: PageTraffic, url: str) -> Iterator[None]:
    """Tell what a page does that leaves while it is read, and how long to wait after an error."""
    try:
        yield
    except Retryable as error:
        if error.after is None and not browser.overdue:
            error.after = _retry_after(network, url)
        if browser.overdue:
            raise
        # A page that redirects to another site ends in an error page, with various errors. The
        # driver also calls it a timeout when a page leaves while a script waits in it.
        raise _redirect_error(browser, url) or error from None


def _capture_once(
    browser: Browser,
    network: PageTraffic,
    url: str,
    shot: Path,
    rules: dict[str, Any],
    max_height: int,
    page_id: int | None,
    turn: Callable[[float | None, float], bool],
) -> Captured:
    """What the page shows once it stands still. Raises PageMoved when it did not, and as
    `capture` does.
    """
    with _explained(browser, network, url):
        settled = _settle(browser, network, rules, turn)
        browser.promise(_FREEZE, rules)
        extraction = browser.script(page_script("extract.js"), rules)
    page = extraction["page"]
    if not _same_site(page["url"], url):
        raise _redirect_error(browser, url) or OtherPage("redirected_away", page["url"])
    if page_id is not None:  # it may have redirected while it settled
        _check_identity(page, page_id)
    if page["height"] > max_height:
        raise ItemFinal("too_tall", str(page["height"]))
    if page["truncated"]:
        raise ItemFinal("too_many_elements", str(rules["max_elements"]))
    crops = {
        e["id"]: screenshot.pixel_box(e["box"])
        for e in extraction["elements"]
        if e["kind"] == "sprite" and e.get("css") and e["visible"]
    }
    html = browser.script(_HTML)
    # Each tile gets the time of a page, so that tall pages do not fail on a busy machine.
    browser.allow(browser.page_seconds * (1 + screenshot.count_tiles(page["height"])))
    sprites = screenshot.take_screenshot(browser, shot, page["width"], page["height"], crops)
    if browser.script(_MEASURE) != [page["width"], page["height"]]:
        raise PageMoved("page_moved: its size changed during the screenshot")
    return Captured(extraction, html, settled, sprites)


def _settle(
    browser: Browser,
    network: PageTraffic,
    rules: dict[str, Any],
    turn: Callable[[float | None, float], bool],
) -> bool:
    """Wait until the page is stable, and retry failed images, one per turn.

    Returns whether it became stable in time. Raises Retryable.
    """
    end = clock.monotonic() + rules["settle_seconds"]
    tries: Counter[str] = Counter()
    while True:
        left = max(0.0, end - clock.monotonic())
        ready = browser.promise(_SETTLE, {**rules, "settle_seconds": left})
        if not isinstance(ready, dict) or "error" in ready:
            raise Retryable(f"settle_failed: {(ready or {}).get('error', 'no answer')}")
        network.take_in()
        asked = 0
        for image in ready["failed"]:
            served = network.response_of(image)
            if served is None or not served.may_come_back:
                continue
            if tries[image] >= rules["image_tries"]:
                continue
            tries[image] += 1
            # Give a struggling server a moment, even without Retry-After.
            wait = served.after if served.after is not None else 0.1 * tries[image]
            if turn(wait, end - clock.monotonic()):
                browser.script(_AGAIN, image)
                asked += 1
        if not asked:
            return bool(ready["settled"])


def _retry_after(network: PageTraffic, url: str) -> float | None:
    """The Retry-After of a document that the browser did not show."""
    try:
        network.take_in()
    except Retryable:
        return None
    served = network.response_of(url)
    return served.after if served and served.may_come_back else None


def _check_document(browser: Browser, network: PageTraffic, url: str) -> None:
    """Check the status of the document: the browser shows error pages silently."""
    where, status = browser.script(_STATUS)
    if not where.startswith(("http:", "https:")):
        served = network.landed
        if served is not None and 400 <= served.status < 500 and not served.may_come_back:
            raise of_status(served.status)  # without a body to show
        unserved = served is not None and not served.barred and not 0 < served.status < 400
        raise _redirect_error(browser, url) or (NoResponse if unserved else BrowserError)(
            "not_loaded"
        )
    if not _same_site(where, url):
        raise OtherPage("redirected_away", where)
    if status == 429 or status >= 500:
        served = network.response_of(where)
        raise ServerFault(
            f"http_{status}", after=served.after if served else None, unreachable=True
        )
    if status >= 400:
        raise of_status(status)
    if network.cut_off:
        raise ServerFault("cut_off")


def _check_identity(shown: dict[str, Any], page_id: int) -> None:
    """Check page and revision, which MediaWiki names in `mw.config` of each page.

    A title may lead to another page by now. Raises Challenge, OtherPage.
    """
    if not isinstance(shown.get("page_id"), int) or not isinstance(shown.get("revision_id"), int):
        raise Challenge
    if shown["page_id"] != page_id or not shown["revision_id"]:
        raise OtherPage("other_page", str(shown["page_id"]))


def check_page(browser: Browser, url: str, page_id: int | None = None) -> None:
    """Load a page, by its id if given, to see whether the wiki serves it. Raises as `capture`."""
    network = PageTraffic(browser)
    browser.go(url)
    network.take_in()
    _check_document(browser, network, url)
    shown = browser.script(_IDENTITY)
    if page_id is not None:
        _check_identity(shown, page_id)
    elif not isinstance(shown.get("page_id"), int):
        raise Challenge


def _redirect_error(browser: Browser, url: str) -> ItemFinal | None:
    """The error for a page that redirected to another site; None when it did not."""
    try:
        history = browser.devtools("Page.getNavigationHistory", {})
        current = history["entries"][history["currentIndex"]]["url"]
    except (Retryable, KeyError, IndexError):
        return None
    if current.startswith(("http:", "https:")) and not _same_site(current, url):
        return OtherPage("redirected_away", current)
    return None


def _same_site(url: str, other: str) -> bool:
    return urlsplit(url).netloc == urlsplit(other).netloc
