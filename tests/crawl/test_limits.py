"""Tests of `kb.crawl.limits`."""

from dataclasses import replace

import pytest

from kb.core.context import Run
from kb.core.errors import LimitReached
from tests.crawl.runs import crawl
from tests.fourth.service import Service


def test_limit_lists_no_more_than_it_needs_and_goes_on(run: Run, service: Service) -> None:
    with pytest.raises(LimitReached) as stop:
        crawl(replace(run, limit=4), service)
    assert stop.value.summary == {"notes": 4, "failed": 0, "left": 3}
    assert "/notes?page=3" not in service.asked
    assert crawl(run, service)["notes"] == 6
    assert set(service.asked.values()) == {1}
    # A limit that everything fits into is no stop.
    assert crawl(replace(run, limit=4), service)["left"] == 0
