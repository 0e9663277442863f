"""Tests of `kb.crawl.job`."""

import pytest

from kb.core.context import Run
from kb.core.errors import (
    Unreachable,
)
from kb.crawl.job import work
from tests.crawl.test_loop import Batches, summary
from tests.fourth.service import serving


def test_batches_of_a_service_that_is_down_are_left_for_the_next_run(run: Run) -> None:
    with serving(100, page=50) as service:
        feed = Batches(run, service.root)
        feed.bad = frozenset(service.ids)
        with pytest.raises(Unreachable) as stop:
            work(run, feed, summary)
        assert stop.value.summary == {"notes": 1, "failed": 1, "left": 50}
        feed = Batches(run, service.root)
        assert work(run, feed, summary) == {"notes": 100, "failed": 0, "left": 0}
