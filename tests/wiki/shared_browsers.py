"""Browsers that wait for the next crawl of one test process instead of ending with theirs.

Starting one takes longer than showing a page of a test's wiki. Each crawl still asks for browsers
as ever and hands them back: what it was given has no cache, cookies or storage of another crawl,
and one that hung or died was ended and never comes back. That a crawl's own browsers start and end
is what tests without this say (tests/wiki/browser/test_pool.py, crawls in processes of their own).
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from kb.core.errors import Retryable
from kb.wiki.browser import browser
from kb.wiki.browser.browser import Pool
from kb.wiki.crawl import connector

MOST = 4  # browsers that wait; those of a wiki that has ended among them


class _Shelf:
    """Idle browsers with what they were started with."""

    def __init__(self) -> None:
        self._idle: list[tuple[str, browser.Browser]] = []
        self._started: dict[int, str] = {}
        self._lock = threading.Lock()
        self._browser = browser.Browser

    def start(self, programs: Any, **options: Any) -> browser.Browser:
        """One that waits and was started alike, else a new one."""
        wanted = repr((programs, sorted(options.items())))
        while (held := self._take(wanted)) is not None:
            try:
                _clear(held, options["origins"])
            except Retryable:
                held.end()
                continue
            return held
        made = self._browser(programs, **options)
        self._started[id(made)] = wanted
        return made

    def keep(self, idle: browser.Browser) -> None:
        """It waits from now on; the one that has waited longest makes room."""
        with self._lock:
            oldest = self._idle.pop(0)[1] if len(self._idle) >= MOST else None
            self._idle.append((self._started[id(idle)], idle))
        if oldest is not None:
            oldest.end()

    def close(self) -> None:
        """End them all."""
        for _, held in self._idle:
            held.end()

    def _take(self, wanted: str) -> browser.Browser | None:
        with self._lock:
            for number, (started, held) in enumerate(self._idle):
                if started == wanted:
                    del self._idle[number]
                    return held
        return None


def _clear(held: browser.Browser, origins: list[str]) -> None:
    held.go("about:blank")
    held.devtools("Network.clearBrowserCache", {})
    held.devtools("Network.clearBrowserCookies", {})
    for origin in origins:
        held.devtools("Storage.clearDataForOrigin", {"origin": origin, "storageTypes": "all"})
    held.record()


@contextmanager
def kept() -> Iterator[None]:
    """While it lasts, crawls in this process share browsers."""
    shelf = _Shelf()

    class Sharing(Pool):
        """What is idle at the end of a crawl waits for the next one."""

        def close(self) -> None:
            while self._idle:
                idle = self._idle.pop()
                self._all.discard(idle)
                shelf.keep(idle)
            super().close()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(browser, "Browser", shelf.start)
        patch.setattr(connector, "Pool", Sharing)
        try:
            yield
        finally:
            shelf.close()
