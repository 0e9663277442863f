"""`kb reddit reconstruct`: full posts and comments again from ids, with the user's own key.

Known ids go through `info`, 100 full names a request, posts and comments together. Posts of the
published `reddit.json` have no comment ids: their whole trees are read, with every nested reply.
Answers wait in a work folder until every id is answered, so a run that was cut off asks again only
for what was in flight; then they are added to the tables and the work folder goes. What other runs
brought into the same folder stays (kb.reddit.earlier).

    out/posts/*.parquet  out/comments/*.parquet     the clean tables' columns, scores of models null
    out/missing.parquet                             key, reason: missing, deleted, removed, purged,
                                                    forbidden, malformed, failed
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from kb.core import vocabulary
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.profile import DEFAULT, load_profile
from kb.core.settings import load_settings
from kb.core.verdict import Summary
from kb.crawl import job
from kb.crawl.loop import Loop
from kb.crawl.session import Session
from kb.crawl.source import Answer, Phase
from kb.net import redact
from kb.reddit import earlier, tables
from kb.reddit.reduce import PAYLOADS
from kb.reddit.source import INFO, MORE, THREAD, TREE, Reddit
from kb.reddit.wanted import Ids, Wanted, asked_for, released
from kb.store import parquet, reading
from kb.store.frontier import Frontier, Item
from kb.store.layout import Layout
from kb.store.lock import writer

LOCK = ".lock"  # in the folder of the tables: one run at a time adds to them
_WHY = {"404": "missing", "410": "missing", "purged": "purged"}


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
    """Typed rows of released ids, for a notebook: `for row in
    kb.reddit.reconstruct("posts-00000-of-00001.parquet"): …`

    `ids`: a file or folder as for `--ids`, several of them, or full names; by default the data
    root's own release. What `out` has already is added to, and comes as well. `settings` are names
    of kb.core.settings (`reddit_client_id="…"`, `kb_data="…"`); the environment and `.env` count as
    for the command. Everything is read first (cut off, the same call goes on), then posts, comments
    and what is missing come in order. Raises as `rebuild`.
    """
    run = run or _run(profile, settings)
    place = Path(out) if out else Layout(run.root).reconstructed
    rebuild(run, ids, place)
    return rows(place)


def rows(out: Path) -> Iterator[Post | Comment | Missing]:
    """The rows of a finished reconstruction."""
    for name, make in (("posts", Post), ("comments", Comment)):
        for path in sorted((out / name).glob("*.parquet")):
            with parquet.open_file(path) as file:
                for batch in file.iter_batches(8_192, columns=list(make._fields)):
                    yield from (make(**row) for row in batch.to_pylist())
    for row in parquet.read_table(out / "missing.parquet").to_pylist():
        yield Missing(row["key"], row["reason"])


def rebuild(run: Run, ids: Ids, out: Path) -> Summary:
    """Read everything, add it to the tables in `out`. With `--again` what was answered before is
    read anew.

    Raises SettingError (also where the tables would take the place of other files) and
    MissingCredential before anything is sent (exit 2); LimitReached, Blocked, Unreachable and
    Interrupted (exit 3;
    the same command goes on); CredentialRefused and WriterLocked (exit 1).
    """
    for name in ("reddit_client_id", "reddit_client_secret", "kb_contact"):
        run.settings.need(name)
    wanted, sources = asked_for(ids, Layout(run.root).release("reddit"))
    digest = wanted.digest()
    tables.check_place(out)
    with writer(out / LOCK, "reddit"):
        earlier.settle(out)
        done, work = earlier.load(out), out / f"{tables.WORK}{digest}"
        if digest in done.answered and not run.again:
            shutil.rmtree(work, ignore_errors=True)
            run.progress.say(f"{out}: every id was answered before; --again reads them anew")
            return Summary(**{**done.answered[digest], **_counts(out, done), "requests": 0})
        stale = earlier.begin(work, done)
        source = Rebuild(run, wanted)
        summary = job.work(run, source, source.summary, place=work, facts=source.facts)
        try:
            unanswered = _unanswered(Layout(work).state("reddit"))
            answers = tables.Answers(
                work, wanted, unanswered, released(sources), stale, source.opened.gone
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
    """Rows of the tables as they are now; what failed is not `missing`, as it is asked for
    again.
    """
    failed = sum(reason == "failed" for reason in earlier.missing(out).values())
    return {
        **{name: done.counts[name] for name in earlier.NAMES},
        "missing": done.counts[earlier.MISSING] - failed,
    }


class Rebuild(Reddit):
    """What is wanted: names, and posts whose whole trees are read. `answered` counts names."""

    phases = (replace(INFO, name="reddit reconstruct"), MORE, THREAD, TREE)

    def __init__(self, run: Run, wanted: Wanted) -> None:
        super().__init__(run)
        self.wanted = wanted
        self.answered = 0

    def identity(self) -> dict[str, str]:
        """The host; ids are of any subreddit."""
        return {"host": super().identity()["host"]}

    def settle(self) -> None:
        """Answers go into a work folder, which has no dumps."""

    def discover(self, frontier: Frontier) -> None:
        """What is wanted, once."""
        if frontier.cursor("seeded"):
            return
        with frontier.transaction():
            frontier.add("info", self.wanted.names)
            frontier.add("tree", self.wanted.trees)
            frontier.set_cursor("seeded", True)

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """As in a crawl."""
        for answer in super().fetch(phase, items):
            yield answer
            self.answered += len(items) if phase.kind == "info" else 0

    def facts(self, phase: Phase) -> dict[str, object]:
        """What stands beside a progress bar."""
        return {"requests": self.requests()}

    def summary(self, session: Session, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {phase.kind: frontier.counts(phase.kind) for phase in self.phases}
        left = vocabulary.left_by("reddit", counts)
        return Summary(
            command="reddit reconstruct",
            source="reddit",
            counted="posts and comments",
            crawled=self.answered + loop.answered["tree"],
            failed=sum(count.get("error", 0) for count in counts.values()),
            pending=frontier.waiting("info", "tree"),
            requests=self.requests(),
            left=sum(left.values()),
            left_by=left,
        )


def _unanswered(state: Path) -> dict[str, str]:
    """What has no answer with content for a reason that is not in the answers: full name →
    reason.
    """
    found: dict[str, str] = {}
    with reading.state(state, PAYLOADS) as frontier:
        for kind, prefix in (("info", ""), ("tree", "t3_"), ("more", "t1_")):
            for key, *_ in frontier.items(kind, "error"):
                found[f"{prefix}{key}"] = "failed"
        for kind, prefix in (("info", ""), ("tree", "t3_")):
            for key, _, reason, _ in frontier.items(kind, "skipped"):
                found[f"{prefix}{key}"] = _WHY.get(reason or "", "forbidden")
    return found


def _run(profile: str | None, settings: dict[str, Any]) -> Run:

    loaded = load_settings(**{**settings, "kb_profile": profile or settings.get("kb_profile")})
    redact.know(loaded.secret_values())
    return Run(
        settings=loaded,
        profile=load_profile(loaded.kb_profile or DEFAULT),
        root=loaded.kb_data.expanduser().absolute(),
    )
