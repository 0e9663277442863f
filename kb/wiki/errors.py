"""Errors of URLs and of the browser, by consequence.

ItemFinal
├── NotAnImage          an image's URL returns a page, as challenges do
├── OtherPage           another page or site came in the place of the page
└── HttpStatus          a URL returns 4xx: it is gone (404, 410 …)
    ├── TransientStatus     408, 425: about this one request
    └── PageRefused         any other 4xx: refuses us, or this page only
Retryable
├── ServerFault         the server returned no complete page; the browser works
│   └── Challenge       another page came instead, as challenges do
├── BrowserError        the browser shows no page and hides the reason
│   └── NoResponse      no page arrived, as the browser noted; the browser works
├── PageMoved           the page changed while it was captured
└── PageTimeout         the page takes too long; its browser is ended

Whether an item is refused or we are is told by other items (kb.wiki.crawl.front_end).
"""

from kb.core.errors import Challenged, ItemFinal, Retryable

_GONE = (404, 410, 414, 451)  # statuses about a URL


class HttpStatus(ItemFinal):
    """An address answers with a status of 400 or more. Its reason is "http_404"."""

    def __init__(self, status: int) -> None:
        super().__init__(f"http_{status}")


class NotAnImage(ItemFinal):
    """HTML in the place of an image; the next run asks for it again."""

    def __init__(self) -> None:
        super().__init__("challenge")


class OtherPage(ItemFinal):
    """A redirect to another site, or another page of the wiki, as a log-in or a consent wall is."""


class TransientStatus(HttpStatus):
    """A status about one request, which says nothing about the page."""


class PageRefused(HttpStatus):
    """The URL is refused. The next run asks for it again."""


class ServerFault(Retryable):
    """The server answered with an error, or with a page that lacks what it needs."""


class Challenge(ServerFault):
    """An answer with status 200 that does not identify itself as what was asked for.

    Challenge pages (Anubis, Cloudflare) are such answers: they are HTML without `mw.config`.
    """

    def __init__(self, reason: str = "challenge") -> None:
        super().__init__(reason)


class BrowserError(Retryable):
    """The browser shows a page of its own instead; a plain request finds the reason."""


class NoResponse(BrowserError):
    """An error without a body arrived, or no answer; the browser itself works."""


class PageMoved(Retryable):
    """The page changed while it was captured, as pages do on a busy machine."""


class PageTimeout(Retryable):
    """A page takes longer than it may."""

    def __init__(self) -> None:
        super().__init__("page_timeout")


# How Chromium names what the network did.
_NETWORK = ("err_address_", "err_connection_", "err_empty_response", "err_name_", "err_timed_out")


def of_browser(reason: str) -> BrowserError:
    """The error for Chromium's word for a page that it does not show, as "err_timed_out"."""
    return NoResponse(reason) if reason.startswith(_NETWORK) else BrowserError(reason)


def of_status(status: int) -> HttpStatus:
    """The error for an answer with a status of 400 or more."""
    if status in (408, 425):
        return TransientStatus(status)
    if status in _GONE or status >= 500:
        return HttpStatus(status)
    return PageRefused(status)


def turned_away(what: str) -> Challenged:
    """The error for a wiki that does not answer this crawler; `what` it does instead."""
    return Challenged(
        what,
        hint="open the wiki in a browser to see what it wants, or ask its operators; then run the"
        " same command again",
    )
