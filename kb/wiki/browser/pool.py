"""A pool of browsers, one a worker. One that hangs or dies is ended as a whole and replaced."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Self, TypeVar

from kb.core.errors import ItemFinal, MissingExtra, Retryable
from kb.wiki.browser.browser import Browser
from kb.wiki.browser.process_guard import Guard
from kb.wiki.errors import ServerFault, Unserved

Result = TypeVar("Result")
PAGES = 250  # a browser that showed many pages has grown; a fresh one costs about a second


class Pool:
    """Browsers are started when first needed, except one: what can't start is found at once.

    Raises MissingExtra when the browser does not start.
    """

    def __init__(self, start: Callable[[Guard], Browser], seconds: float) -> None:
        self._start, self._seconds = start, seconds
        self._lock = threading.Lock()
        self._used: dict[int, int] = {}
        self._all: set[Browser] = set()
        self._guard = Guard()
        try:
            self._idle = [self._new()]
        except BaseException:
            self._guard.close()
            raise

    def _new(self) -> Browser:
        browser = self._start(self._guard)
        with self._lock:
            self._all.add(browser)
            self._used[id(browser)] = 0
        return browser

    def use(
        self, work: Callable[[Browser], Result], first: Callable[[], None] = lambda: None
    ) -> Result:
        """Run `work` with a browser of its own, at most `seconds` long.

        `first` comes before it (waiting for one's turn). Raises what `work` raises; after anything
        but an answer of the server, or none, the browser is replaced.
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
        except (ItemFinal, ServerFault, Unserved):
            healthy = True
            raise
        finally:
            self._used[id(browser)] += 1
            if healthy and not browser.overdue and self._used[id(browser)] < PAGES:
                with self._lock:
                    self._idle.append(browser)
            else:
                self._drop(browser)

    def _drop(self, browser: Browser) -> None:
        with self._lock:
            self._all.discard(browser)
            self._used.pop(id(browser), None)
        browser.end()

    def close(self) -> None:
        """End all browsers; no process is left behind."""
        with contextlib.ExitStack() as stack:
            stack.callback(self._guard.close)
            for browser in list(self._all):
                stack.callback(browser.end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
