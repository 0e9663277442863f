"""Tests of `kb.crawl.phase_scheduler`."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import pytest

from kb.core import clock
from kb.core.context import Run
from kb.core.errors import Blocked
from kb.crawl.job import work
from tests.crawl.feed import NOTES, PAGES, FeedConnector
from tests.crawl.runs import crawl, summary
from tests.crawl.service import Service


def wait_until(what: Callable[[], bool], seconds: float = 1.0) -> None:
    """Until it is so; no longer than some time, as it need not come true."""
    end = time.monotonic() + seconds
    while not what() and time.monotonic() < end:
        time.sleep(0.01)


def test_after_a_block_one_request_finds_out(run: Run, service: Service) -> None:
    service.fault = lambda path: (403, {}) if path == "/notes/n001" else None
    for _ in range(2):
        with pytest.raises(Blocked):
            crawl(run, service)
    assert service.asked["/notes/n001"] == 2
    # It came behind those that were known: what is always refused keeps no other from being read.
    assert service.asked["/notes/n002"] == 1
    service.fault = lambda path: None
    assert crawl(run, service)["notes"] == 8


def test_wait_sleeps_through_a_block(
    run: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[object] = []

    def wake_up(moment: object) -> None:
        slept.append(moment)
        service.fault = lambda path: None

    monkeypatch.setattr(clock, "sleep_until", wake_up)
    service.fault = lambda path: (403, {}) if path == "/notes/n001" else None
    assert crawl(replace(run, wait=True), service)["notes"] == 10
    assert len(slept) == 1


def test_a_service_waits_for_one_that_sleeps(
    run: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its work comes from there: with --wait nothing is left behind when the block is over."""
    blocked = "/notes?page=2"
    service.fault = lambda path: (403, {}) if path == blocked else None

    def wake_up(moment: object) -> None:
        wait_until(lambda: "notes" not in "".join(each.name for each in threading.enumerate()))
        service.fault = lambda path: None

    monkeypatch.setattr(clock, "sleep_until", wake_up)
    feed = FeedConnector(run, service.root)
    feed.phases = (PAGES, replace(NOTES, service="notes"))
    done = work(replace(run, wait=True), feed, summary)
    assert done == {"notes": 10, "failed": 0, "left": 0}
