"""Tells what concerns one page or file from a front end that turns the whole crawl away.

A refusal is a fact about an item only while others are answered as before. So when an item is
refused, others are asked for: where they are refused as well, the crawl stops and all of them wait.
"""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from kb.core.errors import Challenged, ItemFinal, Retryable
from kb.wiki.browser.browser import Pool
from kb.wiki.capture.page import check_page
from kb.wiki.crawl.discover import Comparison
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.errors import Challenge, NotAnImage, PageRefused, turned_away

_OF_US = (Challenge, NotAnImage, PageRefused)  # no deleted or moved item is answered like this
# Asks for another item, and raises as a fetch does; whether that one was answered before.
Probe = tuple[Callable[[], None], bool]


class FrontEnd:
    """What the wiki's front end lets this crawl have. Thread-safe."""

    def __init__(self) -> None:
        self._serves = False  # it has shown a page in this run
        self._first, self._comparing = threading.Lock(), threading.Lock()
        self._error: Challenged | None = None

    def raise_challenged(self) -> None:
        """Raises Challenged when the crawl was turned away."""
        if self._error is not None:
            raise self._error

    @contextlib.contextmanager
    def page(self) -> Iterator[None]:
        """Around a page. Until one is shown they are asked for one by one, so that few are where
        all are refused. Raises as `raise_challenged`.
        """
        with contextlib.nullcontext() if self._serves else self._first:
            self.raise_challenged()
            yield

    def shown(self) -> None:
        """A page was shown."""
        self._serves = True

    def compare(self, reason: str, others: Iterable[Probe]) -> None:
        """An item was refused for `reason`: see whether others are. Raises Challenged when none of
        them is answered.
        """
        with self._comparing:
            self.raise_challenged()
            refused = False
            for probe, answered_before in others:
                try:
                    probe()
                except (ItemFinal, Challenge) as error:
                    refused = True
                    # A page that was shown may be gone or another one by now, so more are asked.
                    if answered_before and isinstance(error, _OF_US):
                        break
                except Retryable:
                    continue  # it says nothing about us
                else:
                    return
            if refused:
                self._error = turned_away(
                    f"the wiki turns the crawl away: it does not show other pages either ({reason})"
                )
                raise self._error


def page_probes(web: WikiHosts, pool: Pool, others: Iterable[Comparison]) -> Iterator[Probe]:
    """Pages are shown in the browser, as front ends treat plain clients differently."""
    for other in others:
        url = web.rebase_loopback(other.url)
        if web.allowed(url):
            show = partial(check_page, url=url, page_id=other.page_id)
            yield partial(pool.use, show, first=web.pace.wait), other.answered_before


def file_probes(web: WikiHosts, others: Iterable[Comparison]) -> Iterator[Probe]:
    """Files are asked for, and not read."""
    for other in others:
        yield partial(web.check_file, other.url), other.answered_before
