"""Tests of `kb.crawl.session`."""

import pytest

from kb.core.context import Run
from kb.core.errors import (
    OtherService,
    WriterLocked,
)
from kb.crawl.job import work
from kb.crawl.session import open_session
from tests.crawl.test_loop import crawl, summary
from tests.fourth.feed.connector import FeedConnector
from tests.fourth.service import Service


def test_one_writer_and_one_feed_a_root(run: Run, service: Service) -> None:
    crawl(run, service)
    with (
        open_session(run, FeedConnector(run, service.root)),
        pytest.raises(WriterLocked, match="pid"),
    ):
        crawl(run, service)
    with pytest.raises(OtherService):
        work(run, FeedConnector(run, "http://elsewhere.example"), summary)
