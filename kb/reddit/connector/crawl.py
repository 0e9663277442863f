"""`kb reddit crawl`: listings of the subreddit, then every comment of every post in them."""

from __future__ import annotations

from datetime import datetime

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.reddit.connector.discover import KINDS
from kb.reddit.connector.reduce import crawled, outside
from kb.reddit.connector.source import RedditSource
from kb.reddit.connector.unfinished import unread_parts
from kb.reddit.spec import SPEC


def crawl(run: Run, since: datetime | None = None, until: datetime | None = None) -> Summary:
    """Read what is left. `since` and `until` bound when posts were made (UTC, since included).

    What lies outside is left out, and read by a later crawl with another span or none.
    Raises LimitReached, Blocked, Unreachable, Interrupted (exit 3), CredentialRefused and
    FatalError (exit 1); the summary so far is on the error.
    """
    source = RedditSource(run, since, until)

    def summary(session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {kind: frontier.counts(kind) for kind in KINDS}
        left = SPEC.left_by(counts)
        left_out = outside(frontier)
        return Summary(
            command="reddit crawl",
            source="reddit",
            counted="posts",
            crawled=loop.answered["tree"],
            crawled_in_all=crawled(frontier),
            missing=counts["tree"].get("skipped", 0) - left_out,
            failed=sum(counts[kind].get("error", 0) for kind in KINDS),
            incomplete_posts=len(unread_parts(frontier)),
            pending=frontier.waiting("tree"),
            comments=source.comments,
            outside=left_out,
            posts=sum(counts["tree"].values()),
            requests=source.requests(),
            left=sum(left.values()),
            left_by=left,
        )

    return work(
        run,
        source,
        summary,
        facts=lambda phase: {"comments": source.comments, "requests": source.requests()},
    )
