"""`kb refresh reddit`: scores, removals and deletions read again through `info`, 100 ids a request.

Read again is what a dump brought, whose scores are a snapshot (some months of them wrong), and what was
read live longer than the profile's `max_age_days` ago. The newer answer wins when filtering; what was
deleted, removed or is no longer there leaves with `kb purge reddit`.
"""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

from kb.core import clock, signals
from kb.core.context import Run
from kb.core.errors import FatalError, ItemFinal, KbError, LimitReached, Retryable, Unreachable
from kb.core.profile.reddit import Links
from kb.core.verdict import Summary
from kb.reddit import parse
from kb.reddit.client import INFO
from kb.reddit.crawl import DOWN, Session, patient, session
from kb.store import rawlog

KIND = "info"


class Newest(NamedTuple):
    """What the newest answer says about a thing. `at` is text (sortable), empty when a dump does not say."""

    at: str
    live: bool
    post: str
    there: bool
    gone: str


def newest(root: Path, links: Links) -> dict[str, Newest]:
    """The newest answer about each post and comment, by full name; stubs and things without id left out."""
    found: dict[str, Newest] = {}
    for kind in parse.KINDS:
        reader = parse.Reader(kind, links)
        for path in rawlog.segments(root, "reddit", kind):
            for _, line in rawlog.Frames(path):
                for row in reader.envelope(line):
                    if row["state"] not in ("there", "missing"):
                        continue
                    at, name = row["fetched_at"] or "", row["fullname"]
                    before = found.get(name)
                    # As in assemble: the later kind wins where two are as old, so that both tell the same.
                    if before is None or (before.at, before.live) <= (at, row["live"]):
                        found[name] = Newest(at, row["live"], row["post_id"] or (before.post if before else ""), row["state"] == "there", row.get("gone") or "")
    return found


def refresh(run: Run) -> Summary:
    """Read again what is due. Raises MissingCredential (exit 2), LimitReached, Blocked, Unreachable and
    Interrupted (exit 3; the same command goes on) and CredentialRefused, with the summary so far.
    """
    with session(run) as at:
        section = run.profile.section("reddit")
        oldest = clock.stamp(clock.now() - timedelta(days=section.max_age_days))
        known = newest(run.root, section.links)
        # What is missing or was deleted by its author stays so; a removal may be taken back.
        due = [(name, row.post) for name, row in known.items()
               if name not in at.gone and row.there and row.gone != "deleted" and (not row.live or row.at < oldest)]
        # Posts first; comments of a post beside each other.
        due.sort(key=lambda entry: (entry[0][:2] != "t3", entry[1], entry[0]))
        at.frontier.remove(KIND, [key for key, *_ in at.frontier.items(KIND)])
        at.frontier.add(KIND, [(name, {"post": post}) for name, post in due])
        return _read(run, at, len(due), section.max_age_days)


def _read(run: Run, at: Session, total: int, days: int) -> Summary:
    summary = Summary(source="reddit", crawled=0, missing=0, failed=0, requests=0, left=total)
    before, failures = at.frontier.requests()[0], 0
    if not total:
        run.progress.say(f"reddit: nothing is older than {days} days, and nothing is from dumps alone")
        return summary
    task = run.progress.task("refresh", total=total, unit="ids")

    def count() -> Summary:
        counts = at.frontier.counts(KIND)
        summary.update(requests=at.frontier.requests()[0] - before, failed=counts.get("error", 0),
                       left=counts.get("todo", 0) + counts.get("in_progress", 0))
        return summary

    try:
        while at.frontier.ready(KIND):
            signals.stop.check()
            room = INFO if run.limit is None else min(INFO, run.limit - summary["crawled"])
            if room <= 0:
                raise LimitReached(f"{summary['crawled']} ids were read (--limit {run.limit})", hint="run the same command to go on")
            items = at.frontier.take(KIND, room)
            names = [item.key for item in items]
            try:
                answer = patient(run, lambda names=names: at.client.info(names))
            except Retryable as error:
                at.frontier.mark(KIND, names, "error", error.reason)
                failures += 1
                if failures >= DOWN:
                    raise Unreachable(f"Reddit failed {failures} times in a row ({error.reason})",
                                      hint="run the same command later: it goes on where it stopped") from None
                continue
            except ItemFinal as error:
                raise FatalError(f"Reddit does not answer info ({error})") from None
            failures = 0
            at.record(KIND, "api/info", {"id": ",".join(names), "posts": [item.payload["post"] for item in items]}, 200, answer)
            given = {f"{child['kind']}_{child['data'].get('id')}" for child in answer["data"]["children"]}
            summary["crawled"] += len(names)
            summary["missing"] += sum(name not in given for name in names)
            task.advance(len(names), missing=summary["missing"])
    except KbError as error:
        error.summary = count()
        raise
    finally:
        task.close()
    return count()
