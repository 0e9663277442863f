"""Keeps a pool of browsers, one per worker, and replaces those that hang or die."""

import contextlib
import threading
from collections.abc import Callable
from typing import Self, TypeVar

from kb.core.errors import ItemFinal, MissingExtra, Retryable
from kb.wiki.browser.browser import Browser
from kb.wiki.errors import NoResponse, ServerFault

Result = TypeVar("Result")
PAGES = 250  # pages per browser: its memory grows, and a new one costs about a second


class Pool:
    """Starts one browser at once, so that a broken installation shows, and others on demand.

    Raises MissingExtra when the browser does not start.
    """

    def __init__(self, start: Callable[[], Browser], seconds: float) -> None:
        self._start, self._seconds = start, seconds
        self._lock = threading.Lock()
        self._all: set[Browser] = set()
        self._idle = [self._new()]

    def _new(self) -> Browser:
        browser = self._start()
        with self._lock:
            self._all.add(browser)
        return browser

    def use(
        self, work: Callable[[Browser], Result], first: Callable[[], None] = lambda: None
    ) -> Result:
        """Run `work` with an exclusive browser, limited to `seconds`.

        `first` runs before the limit starts (waiting for a turn). Raises what `work` raises. The
        browser is reused after success and after errors of the server, and replaced after others.
        """
        with self._lock:
            browser = self._idle.pop() if self._idle else None
        try:
            browser = browser or self._new()
        except MissingExtra as error:  # one has started before
            raise Retryable(f"browser_start: {error}") from error
        healthy = False
        try:
            first()
            with browser.within(self._seconds):
                result = work(browser)
            healthy = True
            return result
        except (ItemFinal, ServerFault, NoResponse):
            healthy = True
            raise
        finally:
            browser.uses += 1
            if healthy and not browser.overdue and browser.uses < PAGES:
                with self._lock:
                    self._idle.append(browser)
            else:
                with self._lock:
                    self._all.discard(browser)
                browser.end()

    def close(self) -> None:
        """End all browsers and their processes."""
        with contextlib.ExitStack() as stack:
            for browser in list(self._all):
                stack.callback(browser.end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
