"""Runs of the feed's crawl, and what they left."""

from kb.core.context import Run
from kb.core.summary import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
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
