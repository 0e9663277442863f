"""`kb refresh reddit`: scores, removals and deletions read again through `info`, 100 ids a request.

Due are things from dumps, whose scores are a snapshot (wrong for some months), and things that were
read live more than the profile's `max_age_days` ago. The filter uses the newer answer; `kb purge
reddit` removes what was deleted, removed or is missing.
"""

import logging
from collections.abc import Collection, Iterator
from dataclasses import replace
from datetime import datetime, timedelta

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.core.context import Run
from kb.core.errors import Retryable
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Opened, Phase
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.reddit.crawl.connector import RedditConnector
from kb.reddit.crawl.reduce import RefreshItem
from kb.reddit.crawl.subreddit import INFO
from kb.reddit.parse import answer_tree
from kb.reddit.parse.latest_state import LatestState, latest_state
from kb.store.exhausted import full_disk_is_resumable
from kb.store.state.frontier import ROUND, Frontier, Item, going_on
from kb.store.tables import database, parquet, reading

_COLUMNS: dict[str, pa.DataType] = {
    "is_comment": pa.bool_(),
    "post_id": pa.string(),
    "fullname": pa.string(),
    "there": pa.bool_(),
}
_DUE = pa.schema(_COLUMNS)
# If nearly all of at least so many ids are missing, the subreddit is more likely closed.
_MANY, _MOST = 100, 0.9
_NONE_OF = 10  # an answer without any of at least so many known things is not believed
_log = logging.getLogger("kb.reddit")


def refresh(run: Run, older_than: int | None = None) -> Summary:
    """Read again what is due; with --again also what was missing.

    `older_than` days count instead of the profile's age (0: everything). What it found due is kept
    until it is read, so the same command resumes. Raises MissingCredential
    before anything is sent; Stopped (the same command resumes) and CredentialRefused, with the
    summary so far.
    """
    source = RedditRefresh(run, older_than)
    try:
        return work(
            run,
            source,
            source.summary,
            phases=[replace(INFO, name="refresh")],
            facts=lambda phase: {"missing": source.missing},
        )
    finally:
        source.warn()


class RedditRefresh(RedditConnector):
    """Reads due things again by name. Counts `answered` ids and the `missing` ones of them."""

    def __init__(self, run: Run, older_than: int | None) -> None:
        super().__init__(run)
        self.older_than = older_than
        self.days = self.section.max_age_days if older_than is None else older_than
        self.answered = self.missing = 0
        self._closed = False  # whether the last answer is not believed

    def begin(self, opened: Opened) -> None:
        """Check whether this refresh was interrupted, before its failed items are opened again."""
        super().begin(opened)
        self._stopped = going_on(opened.frontier, INFO.kind, self.older_than)

    def discover(self, frontier: Frontier) -> None:
        """Add what is due now, unless an interrupted refresh continues."""
        goes_on = self._stopped and going_on(frontier, INFO.kind, self.older_than)
        if self.run.again or not goes_on:
            self._seek(frontier)
        if not frontier.ready(INFO.kind):
            self.run.progress.say(
                f"reddit: nothing is due (older than {self.days} days, or from dumps only)"
            )

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """Up to 100 names."""
        for answer in super().fetch(phase, items):
            given = {
                f"{thing.kind}_{thing.data.get('id')}"
                for thing in answer_tree.things(answer.response)
            }
            asked = str(answer.params["id"]).split(",")
            self._believe([item for item in items if item.key in asked], given)
            yield answer
            self.answered += len(asked)
            self.missing += sum(key not in given for key in asked)

    def _believe(self, items: list[Item], given: Collection[str]) -> None:
        """Raises Retryable for an answer that has none of many known things, and for the next ones
        that have none either.

        That is what a subreddit looks like that is closed for a day. Recorded, the answer would
        say that all of them are gone, and the next purge would remove them. For a few ids that is
        plausible, so the subreddit itself is requested.
        """
        there = sum(item.payload is None or item.payload.there for item in items)
        given_any = any(item.key in given for item in items)
        none = not given_any and there > 0
        self._closed = none and (self._closed or there >= _NONE_OF or self._is_shut)
        if self._closed:
            raise Retryable(
                f"Reddit returned none of {len(items)} posts and comments that existed"
                " (a closed subreddit?); nothing is treated as deleted"
            )

    @cached_property
    def _is_shut(self) -> bool:
        return self._fetch.is_shut()

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        counts = session.frontier.counts(INFO.kind)
        left = SOURCES["reddit"].left_by({INFO.kind: counts})
        return Summary(
            command="refresh reddit",
            source="reddit",
            counted="posts and comments",
            crawled=self.answered,
            missing=self.missing,
            failed=counts.get("error", 0),
            requests=session.requests()[0],
            left=sum(left.values()),
            left_by=left,
        )

    def warn(self) -> None:
        """Warn when nearly everything is missing."""
        if self.answered < _MANY or self.missing <= _MOST * self.answered:
            return
        _log.warning(
            f"Reddit returned only {self.answered - self.missing} of {self.answered} ids: check on"
            " the site whether they are gone before `kb purge reddit` removes them here;"
            " `kb refresh reddit --again` requests them again"
        )

    def _seek(self, frontier: Frontier) -> None:
        """Put what is due into the frontier."""
        oldest = oldest_due(self.days, self.older_than)
        with latest_state(self.run) as things:
            path = things.folder / "due.parquet"
            with full_disk_is_resumable(path), parquet.writing(path, _DUE) as file:
                for rows in due(things, self.opened.purged, oldest, self.run.again):
                    file.write_table(rows)
            con = database.over([path], things.folder, memory="1GB")
            order = f"SELECT * FROM {reading.scan([path])} ORDER BY is_comment, post_id, fullname"
            with con, frontier.transaction():
                frontier.replace(
                    INFO.kind,
                    (
                        (row["fullname"], RefreshItem(row["post_id"], row["there"]))
                        for batch in con.sql(order).to_arrow_reader()
                        for row in batch.to_pylist()
                    ),
                )
                frontier.set_cursor(ROUND, self.older_than)


def oldest_due(days: int, older_than: int | None) -> datetime | None:
    """Things read before this are due; None means everything, also things read this very second."""
    return None if older_than == 0 else clock.now() - timedelta(days=days)


def due(
    things: LatestState, purged_names: Collection[str], oldest: datetime | None, with_missing: bool
) -> Iterator[pa.Table]:
    """The due things of each share; without `oldest` all that exist, with `with_missing` also those
    that were missing.
    """
    purged = pa.array(sorted(purged_names), pa.string())
    for rows in things:
        before = pa.scalar(oldest, rows["fetched_at"].type)
        # Without a bound, or without a date, everything counts as old.
        old = pc.or_(
            pc.invert(rows["live"]), pc.fill_null(pc.less(rows["fetched_at"], before), True)
        )
        # Deletions by authors are final; moderators may restore what they removed.
        here = pc.and_(rows["there"], pc.fill_null(pc.not_equal(rows["gone"], "deleted"), True))
        wanted = pc.and_(old, here)
        if with_missing:
            wanted = pc.or_(wanted, pc.invert(rows["there"]))
        rows = rows.filter(pc.and_(wanted, pc.invert(pc.is_in(rows["fullname"], purged))))
        is_comment = pc.starts_with(rows["fullname"], "t1_")
        posts = pc.fill_null(rows["post_id"], "")
        yield pa.table([is_comment, posts, rows["fullname"], rows["there"]], schema=_DUE)
