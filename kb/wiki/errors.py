"""Errors of URLs and of the browser, by consequence.

ItemFinal
├── NoPicture           an image's address answers with a page, as challenges do
└── HttpStatus          an address answers with 4xx
    ├── NotNow              408, 425: about this one request
    └── Refused             401, 403: us it refuses, or this page alone
Retryable
├── Served              the server answered, though not with a whole page; the browser did well
│   └── Challenge           another page came in its place, as challenges do
├── NotShown            the browser shows nothing of a page and hides why
│   └── Unserved            no page came, as the browser noted; it did well
└── PageTimeout         the page takes too long; its browser is ended
"""

from kb.core.errors import ItemFinal, Retryable


class HttpStatus(ItemFinal):
    """An address answers with a status of 400 or more. Its reason is "http_404"."""

    def __init__(self, status: int) -> None:
        super().__init__(f"http_{status}")


class NoPicture(ItemFinal):
    """HTML in the place of an image; the next run asks for it again."""

    def __init__(self) -> None:
        super().__init__("challenge")


class NotNow(HttpStatus):
    """An answer about one request, which says nothing about the page."""


class PageRefused(HttpStatus):
    """The address is not for us; whether that is so for the whole wiki, its front page says."""


class ServerFault(Retryable):
    """The server answered with an error, or with a page that lacks what it needs."""


class Challenge(ServerFault):
    """An answer with status 200 that does not identify itself as a page of the wiki.

    Challenge pages (Anubis, Cloudflare) are such answers: they are HTML without `mw.config`.
    """

    def __init__(self) -> None:
        super().__init__("challenge")


class NotShown(Retryable):
    """The browser shows a page of its own instead; a plain request finds out why."""


class Unserved(NotShown):
    """An error without a text came, or no answer; nothing is wrong with the browser that asked."""


class PageTimeout(Retryable):
    """A page takes longer than it may."""

    def __init__(self) -> None:
        super().__init__("page_timeout")


# How Chromium names what the network did.
_NETWORK = ("err_address_", "err_connection_", "err_empty_response", "err_name_", "err_timed_out")


def of_browser(reason: str) -> NotShown:
    """The error for Chromium's word for a page that it does not show, as "err_timed_out"."""
    return Unserved(reason) if reason.startswith(_NETWORK) else NotShown(reason)


def of_status(status: int) -> HttpStatus:
    """The error for an answer with a status of 400 or more."""
    if status in (401, 403):
        return PageRefused(status)
    if status in (408, 425):
        return NotNow(status)
    return HttpStatus(status)
