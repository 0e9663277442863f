"""Tests of `kb.crawl.session`."""

from dataclasses import replace

import pytest

from kb.core.context import Run
from kb.core.errors import (
    LimitReached,
    OtherService,
    Unreachable,
    WriterLocked,
)
from kb.crawl.connector import Phase
from kb.crawl.job import work
from kb.crawl.session import open_session
from kb.store.state.frontier import Item
from tests.crawl.feed import NOTES, PAGES, FeedConnector
from tests.crawl.runs import crawl
from tests.crawl.service import Service, serving
from tests.crawl.test_loop import Batches, summary


def test_one_writer_and_one_feed_a_root(run: Run, service: Service) -> None:
    crawl(run, service)
    with (
        open_session(run, FeedConnector(run, service.root)),
        pytest.raises(WriterLocked, match="pid"),
    ):
        crawl(run, service)
    with pytest.raises(OtherService):
        work(run, FeedConnector(run, "http://elsewhere.example"), summary)


def test_what_is_left_out_takes_nothing_of_the_limit(run: Run, service: Service) -> None:
    class Early(FeedConnector):
        phases = (replace(NOTES, seeks=True), PAGES)

        def leave_out(self, phase: Phase, item: Item) -> str | None:
            return "late" if item.key >= "n004" else None

    early = Early(run, service.root)
    assert work(replace(run, limit=4), early, summary) == {"notes": 4, "failed": 0, "left": 0}


def test_limit_lists_no_more_than_it_needs_and_goes_on(run: Run, service: Service) -> None:
    with pytest.raises(LimitReached) as stop:
        crawl(replace(run, limit=4), service)
    assert stop.value.summary == {"notes": 4, "failed": 0, "left": 3}
    assert "/notes?page=3" not in service.asked
    assert crawl(run, service)["notes"] == 6
    assert set(service.asked.values()) == {1}
    # A limit that everything fits into is no stop.
    assert crawl(replace(run, limit=4), service)["left"] == 0


def test_batches_of_a_service_that_is_down_are_left_for_the_next_run(run: Run) -> None:
    with serving(100, page=50) as service:
        feed = Batches(run, service.root)
        feed.bad = frozenset(service.ids)
        with pytest.raises(Unreachable) as stop:
            work(run, feed, summary)
        assert stop.value.summary == {"notes": 1, "failed": 1, "left": 50}
        feed = Batches(run, service.root)
        assert work(run, feed, summary) == {"notes": 100, "failed": 0, "left": 0}
