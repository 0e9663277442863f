"""`kb reddit reconstruct`: full posts and comments again from ids, with the user's own key.

Known ids go through `info`, 100 full names a request, posts and comments together. Posts of the
published `reddit.json` have no comment ids: their whole trees are read, with every nested reply.
Answers wait in a work folder until every id is answered, so a run that was cut off asks again only
for what was in flight; then they are added to the tables and the work folder goes. What other runs
brought into the same folder stays (kb.reddit.earlier).

    out/posts/*.parquet  out/comments/*.parquet     the clean tables' columns, scores of models null
    out/missing.parquet                             key, reason: missing, deleted, removed, purged, forbidden, malformed, failed
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from kb.core import vocabulary
from kb.core.context import Run
from kb.core.errors import FatalError, ItemFinal, KbError, LimitReached, Retryable
from kb.core.profile import DEFAULT, load_profile
from kb.core.progress import Task
from kb.core.settings import load_settings
from kb.core.verdict import Summary
from kb.net import redact
from kb.reddit import earlier, tables
from kb.reddit.client import INFO
from kb.reddit.crawl import Crawl, Session, session
from kb.reddit.wanted import Ids, Wanted, asked_for, released
from kb.store.lock import writer

LOCK = ".lock"  # in the folder of the tables: one run at a time adds to them
OUT = Path("export", "reconstructed")  # below the data root


class Post(NamedTuple):
    """A post that is still there; columns as in clean/reddit/posts."""

    post_id: str
    type: str
    created_utc: datetime
    score: int
    num_comments: int | None
    upvote_ratio: float | None
    score_source: str
    fetched_at: datetime
    title: str
    body: str | None
    author_hash: str | None
    source_url: str | None
    link_kind: str | None
    is_crosspost: bool
    poll_options: list[str] | None


class Comment(NamedTuple):
    """A comment that is still there; columns as in clean/reddit/comments."""

    comment_id: str
    post_id: str
    parent_id: str
    depth: int | None
    created_utc: datetime
    score: int | None
    score_source: str
    fetched_at: datetime
    body: str
    author_hash: str | None


class Missing(NamedTuple):
    """A full name that was asked for and is gone, or (reason "failed") not answered yet."""

    key: str
    reason: str


def reconstruct(
    ids: Ids = None,
    *,
    out: Path | str | None = None,
    run: Run | None = None,
    profile: str | None = None,
    **settings: Any,
) -> Iterator[Post | Comment | Missing]:
    """Typed rows of released ids, for a notebook: `for row in kb.reddit.reconstruct("posts-00000-of-00001.parquet"): …`

    `ids`: a file or folder as for `--ids`, several of them, or full names; by default the data root's own
    release. What `out` has already is added to, and comes as well. `settings`
    are names of kb.core.settings (`reddit_client_id="…"`, `kb_data="…"`); the environment and `.env` count
    as for the command. Everything is read first (cut off, the same call goes on), then posts, comments and
    what is missing come in order. Raises as `rebuild`.
    """
    run = run or _run(profile, settings)
    place = Path(out) if out else run.root / OUT
    rebuild(run, ids, place)
    return rows(place)


def rows(out: Path) -> Iterator[Post | Comment | Missing]:
    """The rows of a finished reconstruction."""

    for name, make in (("posts", Post), ("comments", Comment)):
        for path in sorted((out / name).glob("*.parquet")):
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(8_192, columns=list(make._fields)):
                    yield from (make(**row) for row in batch.to_pylist())
    for row in pq.read_table(out / "missing.parquet").to_pylist():
        yield Missing(row["key"], row["reason"])


def rebuild(run: Run, ids: Ids, out: Path) -> Summary:
    """Read everything, add it to the tables in `out`. With `--again` what was answered before is read anew.

    Raises SettingError (also where the tables would take the place of other files) and MissingCredential
    before anything is sent (exit 2); LimitReached, Blocked, Unreachable and Interrupted (exit 3; the same
    command goes on); CredentialRefused and WriterLocked (exit 1).
    """
    for name in ("reddit_client_id", "reddit_client_secret", "kb_contact"):
        run.settings.need(name)
    wanted, sources = asked_for(ids, run.root / "release" / "reddit")
    digest = wanted.digest()
    tables.check_place(out)
    with writer(out / LOCK, "reddit"):
        earlier.settle(out)
        done, work = earlier.load(out), out / f"{tables.WORK}{digest}"
        if digest in done.answered and not run.again:
            shutil.rmtree(work, ignore_errors=True)
            run.progress.say(f"{out}: every id was answered before; --again reads them anew")
            return Summary(**{**done.answered[digest], **_counts(out, done), "requests": 0})
        with session(run, work) as at:
            stale = earlier.begin(work, done)
            job = Rebuild(at, wanted)
            summary = job.run()
            try:
                answers = tables.Answers(
                    work, wanted, job.unanswered(), released(sources), stale, at.gone
                )
                done.answered.pop(digest, None)
                done.counts = tables.write(answers, out, run.profile.section("reddit").links)
                done.writes += 1
                summary |= _counts(out, done)
            except KbError as error:
                error.summary = summary
                raise
            earlier.wrote(work, done)
        if not summary["failed"]:
            done.answered[digest] = dict(summary)
        earlier.save(out, done)
        if not summary["failed"]:
            shutil.rmtree(work)
    return summary


def _counts(out: Path, done: earlier.Done) -> dict[str, int]:
    """Rows of the tables as they are now; what failed is not `missing`, as it is asked for again."""
    failed = sum(reason == "failed" for reason in earlier.missing(out).values())
    return {
        **{name: done.counts[name] for name in earlier.NAMES},
        "missing": done.counts[earlier.MISSING] - failed,
    }


class Rebuild(Crawl):
    """One run over what is wanted; of the crawl it has the reading of trees."""

    KINDS = ("info", "tree", "more", "thread")

    def __init__(self, at: Session, wanted: Wanted) -> None:
        super().__init__(at, None, None)
        self.wanted = wanted
        self.asked = 0

    def _seed(self) -> None:
        if not self.frontier.cursor("seeded"):
            with self.frontier.transaction():
                self.frontier.add("info", self.wanted.names)
                self.frontier.add("tree", self.wanted.trees)
                self.frontier.mark("info", self.gone, "skipped", "purged")
                self.frontier.set_cursor("seeded", True)
        for kind in self.KINDS:
            self.frontier.reopen(kind, "error")

    def _show(self) -> Task:
        return self.at.run.progress.task(
            "reddit reconstruct",
            unit="posts and comments",
            waiting=lambda: self.frontier.waiting("info", "tree"),
        )

    def _step(self) -> bool:
        limit = self.at.run.limit
        room = INFO if limit is None else min(INFO, limit - self.asked)
        if not self.frontier.ready("info"):
            return super()._step()
        if room <= 0:
            raise LimitReached(
                f"{self.asked} ids were read (--limit {limit})",
                hint="run the same command to go on",
            )
        names = [item.key for item in self.frontier.take("info", room)]
        try:
            answer = self._wait(lambda: self.at.client.info(names))
        except Retryable as error:
            self._failed("info", names, error)
            return True
        except ItemFinal as error:
            raise FatalError(f"Reddit does not answer info ({error})") from None
        self.at.record("info", "api/info", {"id": ",".join(names)}, 200, answer)
        self.asked += len(names)
        self.bar.advance(len(names), requests=self.frontier.requests()[0] - self.before[0])
        return True

    def summary(self) -> Summary:
        """Figures of this run and what is left."""
        counts = {kind: self.frontier.counts(kind) for kind in self.KINDS}
        left = vocabulary.left_by("reddit", counts)
        return Summary(
            command="reddit reconstruct",
            source="reddit",
            counted="posts and comments",
            crawled=self.asked + self.posts,
            failed=sum(counts[kind].get("error", 0) for kind in self.KINDS),
            pending=self.frontier.waiting("info", "tree"),
            requests=self.frontier.requests()[0] - self.before[0],
            left=sum(left.values()),
            left_by=left,
        )

    def unanswered(self) -> dict[str, str]:
        """What has no answer with content for a reason that is not in the answers: full name → reason."""
        found = {
            f"{prefix}{key}": "failed"
            for kind, prefix in (("info", ""), ("tree", "t3_"), ("more", "t1_"))
            for key, *_ in self.frontier.items(kind, "error")
        }
        for kind, prefix in (("info", ""), ("tree", "t3_")):
            for key, _, reason, _ in self.frontier.items(kind, "skipped"):
                found[f"{prefix}{key}"] = {
                    "404": "missing",
                    "410": "missing",
                    "purged": "purged",
                }.get(reason or "", "forbidden")
        return found


def _run(profile: str | None, settings: dict[str, Any]) -> Run:

    loaded = load_settings(**{**settings, "kb_profile": profile or settings.get("kb_profile")})
    redact.know(loaded.secret_values())
    return Run(
        settings=loaded,
        profile=load_profile(loaded.kb_profile or DEFAULT),
        root=loaded.kb_data.expanduser().absolute(),
    )
