"""Errors of URLs and of the browser, by consequence.

ItemFinal
├── NotAnImage          an image's URL returns a page, as challenges do
└── HttpStatus          a URL returns 4xx
    ├── TransientStatus     408, 425: about this one request
    └── PageRefused         401, 403: refuses us, or this page only
Retryable
├── ServerFault         the server returned no complete page; the browser works
│   └── Challenge       another page came instead, as challenges do
├── BrowserError        the browser shows no page and hides the reason
│   └── NoResponse      no page arrived, as the browser noted; the browser works
└── PageTimeout         the page takes too long; its browser is ended
"""

from kb.core.errors import ItemFinal, Retryable


class HttpStatus(ItemFinal):
    """An address answers with a status of 400 or more. Its reason is "http_404"."""

    def __init__(self, status: int) -> None:
        super().__init__(f"http_{status}")


class NotAnImage(ItemFinal):
    """HTML in the place of an image; the next run asks for it again."""

    def __init__(self) -> None:
        super().__init__("challenge")


class TransientStatus(HttpStatus):
    """A status about one request, which says nothing about the page."""


class PageRefused(HttpStatus):
    """The URL is refused; the front page shows whether the whole wiki is."""


class ServerFault(Retryable):
    """The server answered with an error, or with a page that lacks what it needs."""


class Challenge(ServerFault):
    """An answer with status 200 that does not identify itself as a page of the wiki.

    Challenge pages (Anubis, Cloudflare) are such answers: they are HTML without `mw.config`.
    """

    def __init__(self) -> None:
        super().__init__("challenge")


class BrowserError(Retryable):
    """The browser shows a page of its own instead; a plain request finds the reason."""


class NoResponse(BrowserError):
    """An error without a body arrived, or no answer; the browser itself works."""


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
    if status in (401, 403):
        return PageRefused(status)
    if status in (408, 425):
        return TransientStatus(status)
    return HttpStatus(status)
