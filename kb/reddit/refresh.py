"""`kb refresh reddit`: scores, removals and deletions read again through `info`, 100 ids a request.

Read again is what a dump brought, whose scores are a snapshot (some months of them wrong), and what was
read live longer than the profile's `max_age_days` ago. The newer answer wins when filtering; what was
deleted, removed or is no longer there leaves with `kb purge reddit`.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from contextlib import closing
from datetime import datetime, timedelta
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.core import clock, signals, vocabulary
from kb.core.context import Run
from kb.core.errors import FatalError, ItemFinal, KbError, LimitReached, Retryable, Unreachable
from kb.core.verdict import Summary
from kb.reddit.client import INFO
from kb.reddit.crawl import DOWN, Session, patient, session
from kb.reddit.known import Known, known
from kb.store.atomic import full_disk_is_resumable
from kb.store.frontier import ROUND, going_on
from kb.store.merge import Merge
from kb.store.shards import PAGE

KIND = "info"
_ORDER = ["place", "fullname"]
_MANY, _MOST = (
    100,
    0.9,
)  # of at least so many ids nearly all missing: rather a closed subreddit than so many deletions
_log = logging.getLogger("kb.reddit")


def refresh(run: Run, older_than: int | None = None) -> Summary:
    """Read again what is due; with --again also what was missing.

    `older_than` days count instead of the profile's age (0: everything). What it found due is kept until it is
    read, so the same command goes on where it stopped. Raises MissingCredential (exit 2), LimitReached, Blocked, Unreachable and
    Interrupted (exit 3; the same command goes on) and CredentialRefused, with the summary so far.
    """
    with session(run) as at:
        section = run.profile.section("reddit")
        days = section.max_age_days if older_than is None else older_than
        if run.again or not going_on(at.frontier, KIND, older_than):
            _seek(run, at, oldest_due(days, older_than), older_than)
        return _read(run, at, at.frontier.counts(KIND).get("todo", 0), days)


def oldest_due(days: int, older_than: int | None) -> datetime | None:
    """What was read before is due; None means all that is there, also what was read this very second."""
    return None if older_than == 0 else clock.now() - timedelta(days=days)


def _seek(run: Run, at: Session, oldest: datetime | None, older_than: int | None) -> None:
    """Put what is due into the frontier."""
    with (
        known(run) as things,
        closing(Merge(due_parts(things, at.gone, oldest, run.again), _ORDER, _ORDER)) as due,
    ):
        items = (
            (row["fullname"], {"post": row["place"][1:]})
            for rows in due
            for row in rows.to_pylist()
        )
        with at.frontier.transaction():
            at.frontier.replace(KIND, items)
            at.frontier.set_cursor(ROUND, older_than)


def due_parts(
    things: Known, gone: Collection[str], oldest: datetime | None, again: bool
) -> list[Path]:
    """What is due of each share, with `again` what is missing as well; without `oldest` all that is there.

    `place` is "0" or "1" and the post: posts first, then comments post by post.
    """

    purged, parts = pa.array(sorted(gone), pa.string()), []
    by = [(name, "ascending") for name in _ORDER]
    for number, rows in enumerate(things):
        before = pa.scalar(oldest, rows["fetched_at"].type)
        # Without a bound, or a time of its own, everything counts as old.
        old = pc.or_(
            pc.invert(rows["live"]), pc.fill_null(pc.less(rows["fetched_at"], before), True)
        )
        # What is missing or was deleted by its author stays so; a removal may be taken back.
        here = pc.and_(rows["there"], pc.fill_null(pc.not_equal(rows["gone"], "deleted"), True))
        due = pc.or_(pc.and_(old, here), pc.invert(rows["there"])) if again else pc.and_(old, here)
        rows = rows.filter(pc.and_(due, pc.invert(pc.is_in(rows["fullname"], value_set=purged))))
        rank = pc.if_else(pc.starts_with(rows["fullname"], "t3_"), "0", "1")
        place = pc.binary_join_element_wise(rank, pc.fill_null(rows["post_id"], ""), "")
        rows = pa.table([place, rows["fullname"]], names=_ORDER).sort_by(by)
        parts.append(things.folder / f"due-{number:06d}.parquet")
        with full_disk_is_resumable(parts[-1]):
            marks = pq.SortingColumn.from_ordering(rows.schema, by, "at_end")
            # Pages are small, as a merge has one of every part in memory; a dictionary of unique names is as large as they are.
            pq.write_table(
                rows,
                parts[-1],
                sorting_columns=marks,
                compression="zstd",
                use_dictionary=False,
                data_page_size=PAGE,
            )
    return parts


def _read(run: Run, at: Session, total: int, days: int) -> Summary:
    summary = Summary(
        command="refresh reddit",
        source="reddit",
        counted="posts and comments",
        crawled=0,
        missing=0,
        failed=0,
        requests=0,
        left=total,
        left_by={},
    )
    before, failures = at.frontier.requests()[0], 0
    if not total:
        run.progress.say(
            f"reddit: nothing is older than {days} days, and nothing is from dumps alone"
        )
        return summary
    task = run.progress.task("refresh", total=total, unit="posts and comments")

    def count() -> Summary:
        counts = at.frontier.counts(KIND)
        left = vocabulary.left_by("reddit", {KIND: counts})
        summary.update(
            requests=at.frontier.requests()[0] - before,
            failed=counts.get("error", 0),
            left=sum(left.values()),
            left_by=left,
        )
        return summary

    try:
        while at.frontier.ready(KIND):
            signals.stop.check()
            room = INFO if run.limit is None else min(INFO, run.limit - summary["crawled"])
            if room <= 0:
                raise LimitReached(
                    f"{summary['crawled']} ids were read (--limit {run.limit})",
                    hint="run the same command to go on",
                )
            items = at.frontier.take(KIND, room)
            names = [item.key for item in items]
            try:
                answer = patient(run, lambda names=names: at.client.info(names))
            except Retryable as error:
                at.frontier.mark(KIND, names, "error", error.reason)
                failures += 1
                if failures >= DOWN:
                    raise Unreachable(
                        f"Reddit failed {failures} times in a row ({error.reason})",
                        hint="run the same command later: it goes on where it stopped",
                    ) from None
                continue
            except ItemFinal as error:
                raise FatalError(f"Reddit does not answer info ({error})") from None
            failures = 0
            at.record(
                KIND,
                "api/info",
                {"id": ",".join(names), "posts": [item.payload["post"] for item in items]},
                200,
                answer,
            )
            given = {
                f"{child['kind']}_{child['data'].get('id')}" for child in answer["data"]["children"]
            }
            summary["crawled"] += len(names)
            summary["missing"] += sum(name not in given for name in names)
            task.advance(len(names), missing=summary["missing"])
    except KbError as error:
        error.summary = count()
        raise
    finally:
        task.close(stopped=summary["crawled"] < total)
        if summary["crawled"] >= _MANY and summary["missing"] > _MOST * summary["crawled"]:
            _log.warning(
                f"Reddit gave only {summary['crawled'] - summary['missing']} of {summary['crawled']} ids: look there whether they are gone before "
                "`kb purge reddit` removes them here; `kb refresh reddit --again` asks for them once more"
            )
    return count()
