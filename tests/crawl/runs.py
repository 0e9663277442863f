"""Runs of the feed's crawl, and what they left."""

import time
from collections.abc import Callable
from pathlib import Path

from kb.core.context import Run
from kb.core.summary import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.store.rawlog import rawlog
from tests.crawl.feed import FeedConnector
from tests.crawl.service import Service


def summary(session: CrawlSession, loop: Loop) -> Summary:
    """The figures of a run."""
    return Summary(
        notes=loop.answered["notes"],
        failed=session.frontier.counts("notes").get("error", 0),
        left=session.frontier.waiting("notes", "pages"),
    )


def crawl(run: Run, service: Service) -> Summary:
    """One run of the feed's crawl."""
    return work(run, FeedConnector(run, service.root), summary)


def texts(root: Path) -> list[str]:
    """The notes in the raw log, in the order in which they came."""
    return [each.response["text"] for each in rawlog.envelopes(root, "feed", "notes")]


def wait_until(what: Callable[[], bool], seconds: float = 1.0) -> None:
    """Until it is so; no longer than some time, as it need not come true."""
    end = time.monotonic() + seconds
    while not what() and time.monotonic() < end:
        time.sleep(0.01)
