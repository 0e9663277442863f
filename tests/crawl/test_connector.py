"""Tests of `kb.crawl.connector`."""

from dataclasses import replace

from kb.core.context import Run
from kb.crawl.connector import Phase
from kb.crawl.job import work
from kb.store.state.frontier import Item
from tests.crawl.test_loop import summary
from tests.fourth.feed.connector import NOTES, PAGES, FeedConnector
from tests.fourth.service import Service


def test_what_is_left_out_takes_nothing_of_the_limit(run: Run, service: Service) -> None:
    class Early(FeedConnector):
        phases = (replace(NOTES, seeks=True), PAGES)

        def leave_out(self, phase: Phase, item: Item) -> str | None:
            return "late" if item.key >= "n004" else None

    early = Early(run, service.root)
    assert work(replace(run, limit=4), early, summary) == {"notes": 4, "failed": 0, "left": 0}
