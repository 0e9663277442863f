"""`kb reddit reconstruct`: full posts and comments from ids, with a key of one's own or from dumps.

Known ids go through `info`, 100 full names a request, posts and comments together; of posts without
known comments, as in the published `reddit.json`, the whole trees are read. Answers wait in a work
folder until all are there; then kb.artifacts.restore adds them to the tables of earlier runs.

    out/posts/*.parquet  out/comments/*.parquet     the clean tables' columns, scores of models null
    out/missing.parquet                             key, reason: missing, deleted, removed, purged,
                                                    forbidden, malformed, failed, not in these
                                                    dumps; and when the source said so
    out/.done.json                                  which lists of ids were answered
    out/.work-<digest>                              raw answers of an unfinished run
"""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.restore import FAILED, MISSING, WORK, WantedContent
from kb.core.config.profile import DEFAULT, load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.errors import DamagedData, KbError
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart, PlanPhase
from kb.crawl import job
from kb.crawl.connector import Answer, Phase
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.net import redact
from kb.reddit.crawl.connector import RedditConnector
from kb.reddit.crawl.errors import require
from kb.reddit.crawl.ids import Ids, WantedThings, asked_for, released, subreddit_of
from kb.reddit.crawl.importer import import_files
from kb.reddit.crawl.reduce import PAYLOADS
from kb.reddit.crawl.subreddit import INFO, MORE, THREAD, TREE
from kb.reddit.dumps.cursor import recover_segments
from kb.reddit.dumps.find_dumps import find_dumps
from kb.reddit.dumps.import_file import ImportJob
from kb.reddit.dumps.known_dumps import samples_of
from kb.reddit.dumps.search import write_index
from kb.reddit.parse.anonymize import load_key
from kb.reddit.plan import plan_rebuild
from kb.reddit.restore import tables
from kb.reddit.section import RedditSection
from kb.store import leftovers
from kb.store.atomic import write_bytes
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier, Item
from kb.store.tables import parquet, reading

_WHY = {"404": "missing", "410": "missing", "purged": "purged"}


class KnownIds(RedditConnector):
    """What is wanted: names, and posts whose whole trees are read. `answered` counts names."""

    phases = (replace(INFO, name="reddit reconstruct"), MORE, THREAD, TREE)

    def __init__(self, run: Run, wanted: WantedThings) -> None:
        super().__init__(run)
        self.wanted, self.answered = wanted, 0

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
            frontier.add_keys("info", self.wanted.names)
            frontier.add_keys("tree", self.wanted.trees)
            frontier.set_cursor("seeded", True)

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """As in a crawl."""
        for answer in super().fetch(phase, items):
            yield answer
            self.answered += len(items) if phase.kind == "info" else 0

    def facts(self, phase: Phase) -> dict[str, object]:
        return {"requests": self.opened.requests()[0]}

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {phase.kind: frontier.counts(phase.kind) for phase in self.phases}
        left = SOURCES["reddit"].left_by(counts)
        return Summary(
            command="reddit reconstruct",
            source="reddit",
            counted="posts and comments",
            crawled=self.answered + loop.answered["tree"],
            failed=sum(count.get("error", 0) for count in counts.values()),
            pending=frontier.waiting("info", "tree"),
            requests=session.requests()[0],
            left=sum(left.values()),
            left_by=left,
        )


def unanswered(state: Path) -> dict[str, str]:
    """What has no answer with content for a reason that is not in the answers: full name →
    reason.
    """
    reasons: dict[str, str] = {}
    with reading.state(state, PAYLOADS) as frontier:
        for kind, prefix in (("info", ""), ("tree", "t3_"), ("more", "t1_")):
            for key, *_ in frontier.items(kind, "error"):
                reasons[f"{prefix}{key}"] = "failed"
        for kind, prefix in (("info", ""), ("tree", "t3_")):
            for key, _, reason, _ in frontier.items(kind, "skipped"):
                reasons[f"{prefix}{key}"] = _WHY.get(reason or "", "forbidden")
    return reasons


LOCK = ".lock"  # in a folder of tables outside of the data root: one run at a time adds to them
NOT_IN_DUMPS = "not in these dumps"
WITHOUT_KEY = "archive dumps need no key: --dumps FILE…"


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
    dumps: Sequence[Path | str] = (),
    **settings: Any,
) -> Iterator[Post | Comment | Missing]:
    """Typed rows of released ids, for a notebook: `for row in
    kb.reddit.reconstruct("posts-00000-of-00001.parquet"): …`

    `ids`: a file or folder as for `--ids`, several of them, or full names; by default the data
    root's own release. `dumps` are read instead of asking Reddit: no key, no network. What `out`
    has already is added to, and comes as well. `settings` are names of kb.core.config.settings
    (`reddit_client_id="…"`, `kb_data="…"`); the environment and `.env` count as for the command.
    Everything is read first (cut off, the same call goes on), then posts, comments and what is
    missing come in order. Raises as `rebuild`.
    """
    if run is None:
        loaded = load_settings(**{**settings, "kb_profile": profile or settings.get("kb_profile")})
        redact.know(loaded.secret_values())
        root = loaded.kb_data.expanduser().absolute()
        run = Run(settings=loaded, profile=load_profile(loaded.kb_profile or DEFAULT), root=root)
    place = Path(out) if out else Layout(run.root).reconstructed
    rebuild(run, ids, place, dumps=[Path(file) for file in dumps])
    return rows(place)


def rows(out: Path) -> Iterator[Post | Comment | Missing]:
    """The rows of a finished reconstruction."""
    for name, make in (("posts", Post), ("comments", Comment)):
        for path in parquet_files(out / name):
            with parquet.open_file(path) as file:
                for batch in file.iter_batches(8_192, columns=list(make._fields)):
                    yield from (make(**row) for row in batch.to_pylist())
    for row in parquet.read_table(out / "missing.parquet").to_pylist():
        yield Missing(row["key"], row["reason"])


def rebuild(
    run: Run,
    ids: Ids,
    out: Path,
    *,
    dumps: Sequence[Path] = (),
    removed: Collection[str] = (),
) -> Summary:
    """Read everything and add it to the tables in `out`; with `--again` also what was answered.

    `dumps` are read instead of asking Reddit. `removed` are full names that were purged elsewhere,
    which are never asked for. Raises MissingCredential and SettingError (also where the tables
    would replace other files) before anything is sent, Stopped, CredentialRefused, WriterLocked.
    """
    dumps = find_dumps(run, dumps).files
    answered = {} if run.again else _load(out).answered
    if not (dumps or answered):
        require(run, without=WITHOUT_KEY)
    wanted, sources = asked_for(ids, Layout(run.root).release("reddit"), run.progress.say)
    digest = _digest(wanted, dumps, removed)
    if not dumps and digest not in answered:
        require(run, without=WITHOUT_KEY)
    work = out / f"{WORK}-{digest}"
    tables.check_place(out)
    with _writer(run.root, out):
        done = _settled(out)
        if digest in done.answered and not run.again:
            shutil.rmtree(work, ignore_errors=True)
            state = "these dumps are already read" if dumps else "every id is already answered"
            run.progress.say(f"{out}: {state}; --again reads them again")
            return Summary(**{**done.answered[digest], **_counts(out, done), "requests": 0})
        removed = {*removed, *tombstones.keys(run.root, "reddit")}
        answers = tables.Answers(
            work,
            wanted,
            released(sources),
            purged=removed,
            people=tombstones.people(run.root, "reddit"),
            otherwise=NOT_IN_DUMPS if dumps else "missing",
        )
        if dumps:
            subreddit = "" if wanted.trees else subreddit_of(sources)
            summary = _read_dumps(run, answers, dumps, subreddit)
        else:
            summary = _ask(run, wanted, work, removed)
            answers = answers._replace(unanswered=unanswered(Layout(work).state("reddit")))
        if wanted.bad_lines:
            summary["bad_lines"] = summary.get("bad_lines", 0) + wanted.bad_lines
        return _add(run, answers, out, summary, done, digest)


def _ask(run: Run, wanted: WantedThings, work: Path, removed: Collection[str]) -> Summary:
    """What is wanted, from Reddit → raw answers in the work folder; `removed` is not asked for."""
    source = KnownIds(run, wanted)
    return job.work(run, source, source.summary, place=work, facts=source.facts, removed=removed)


def _settled(out: Path) -> Done:
    """What .done.json says of `out`, after what a killed run left there is cleared away."""
    for name in (tables.DONE, MISSING):
        leftovers.remove_temporary(out / name)
    tables.folder_of(out).settle()
    return _load(out)


def _add(
    run: Run, answers: tables.Answers, out: Path, summary: Summary, done: Done, digest: str
) -> Summary:
    """Add all answers to the tables, and note that this list is answered; `summary` with the counts
    of the tables. What failed keeps its work folder: the next run asks for it alone.
    """
    complete = not summary["failed"]
    try:
        links = run.profile.section(RedditSection).links
        done.counts = tables.add_answers(answers, out, links)
        summary |= _counts(out, done)
    except KbError as error:
        error.summary = summary
        raise
    done.answered.pop(digest, None)
    if complete:
        done.answered[digest] = dict(summary)
    write_bytes(out / tables.DONE, msgspec.json.encode(done))
    if complete:
        shutil.rmtree(answers.work)
    return summary


class Done(msgspec.Struct):
    """What .done.json says: the summary of each list of ids by its digest, and rows of tables."""

    answered: dict[str, dict[str, Any]] = {}
    counts: dict[str, int] = {}


def _load(out: Path) -> Done:
    """What .done.json says of `out`; no list counts as answered where a table is incomplete."""
    try:
        done = msgspec.json.decode((out / tables.DONE).read_bytes(), type=Done)
    except (OSError, msgspec.DecodeError):
        return Done()
    try:
        names = [table.declared.short for table in tables.TABLES]
        missing = parquet.footer(out / MISSING).num_rows
        counts = tables.folder_of(out).counts() | {MISSING: missing}
        if counts == done.counts and all(parquet_files(out / name) for name in names):
            return done
    except (OSError, ValueError, DamagedData):
        pass
    return Done()


def _writer(root: Path, out: Path) -> AbstractContextManager[None]:
    """The right to add to the tables in `out`: a lock of the data root where they lie in it."""
    at = Layout(root)
    if out == at.reconstructed:
        return writer(root, "reconstructed")
    if out.is_relative_to(at.restored()):
        return writer(root, "restored")
    return writer(out / LOCK, "reddit")


def _digest(wanted: WantedThings, dumps: Sequence[Path], removed: Collection[str]) -> str:
    """Identifies what is wanted, from which dumps, and without which names."""
    if not dumps and not removed:
        return wanted.digest()
    names = [*sorted(samples_of(file) for file in dumps), *sorted(removed)]
    return hashlib.sha256(" ".join([wanted.digest(), *names]).encode()).hexdigest()[:16]


def _read_dumps(
    run: Run, answers: tables.Answers, dumps: Sequence[Path], subreddit: str
) -> Summary:
    """Wanted records of the dumps → raw answers in the work folder, as an import writes them.

    `subreddit` is that of all ids, "" where it is unknown.
    """
    work, wanted = answers.work, answers.wanted
    ids, notes = work / "ids", Layout(work).importing("reddit")
    if run.again and not notes.exists():
        run = replace(run, again=False)  # nothing was read yet that could be read anew
    recover_segments(work)
    load_key(run.root)
    if not ids.is_dir():
        with run.progress.task("ids", unit="steps"):
            write_index(wanted.names, wanted.trees, ids, answers.purged)
    room, home = run.limit or 0, str(run.root)
    job_ = ImportJob(str(work), "", subreddit, 0.0, math.inf, room, ids=str(ids), home=home)
    try:
        summary = import_files(replace(run, root=work), job_, dumps)
    except KbError as error:
        if error.summary is not None:
            error.summary = _of_dumps(error.summary)
        raise
    return _of_dumps(summary)


def _of_dumps(summary: Mapping[str, Any]) -> Summary:
    return Summary({**summary, "command": "reddit reconstruct", "failed": 0, "pending": 0})


def _counts(out: Path, done: Done) -> dict[str, int]:
    """Rows of the tables now; what failed is not `missing`, as the next run asks for it."""
    reasons = tables.folder_of(out).missing().values()
    failed = sum(reason.reason == FAILED for reason in reasons)
    counts = {table.declared.short: done.counts[table.declared.short] for table in tables.TABLES}
    return {**counts, "missing": done.counts[MISSING] - failed}


@dataclass(frozen=True)
class ThreadRestore:
    """Restores posts and comments into restored/reddit; dumps are read instead of Reddit."""

    run: Run
    content: WantedContent

    @property
    def wanted(self) -> bool:
        """Whether a folder of Reddit was chosen."""
        return bool(self.content.folders_of("reddit"))

    def check_settings(self, needed: tuple[str, ...]) -> tuple[str, ...]:
        """As `RestoreJob` says. Raises ProfileError without [reddit], MissingCredential."""
        if self.wanted:
            self.run.profile.section(RedditSection)
            if not self.content.dumps and not self._is_answered():
                require(self.run, *needed, without=WITHOUT_KEY)
        return needed

    def plan(self) -> PlanPart:
        """As `RestoreJob.plan`. Raises SettingError."""
        if not self.wanted:
            return PlanPart()
        if self._is_answered():
            return PlanPart()
        key = f"Reddit, {self.run.settings.named('reddit_client_id')}"
        summary = plan_rebuild(self.run, self._folders(), self.content.dumps)
        phases = [PlanPhase(**phase) for phase in summary["phases"]]
        whom = "dumps, no key" if self.content.dumps else key
        return PlanPart([phase.asking(whom) for phase in phases], [str(summary["assumed"])])

    def restore(self) -> Summary:
        """As `RestoreJob.restore`. Raises as `rebuild`."""
        out, removed = Layout(self.run.root).restored("reddit"), self.content.removed("reddit")
        return rebuild(self.run, self._folders(), out, dumps=self.content.dumps, removed=removed)

    def missing(self) -> pa.Table | None:
        """As `RestoreJob.missing`; the prefix of a full name tells posts from comments."""
        path = Layout(self.run.root).restored("reddit") / MISSING
        if not path.is_file():
            return None
        rows = parquet.read_table(path, columns=["key", "reason"])
        keys, reasons = (rows[name].cast(pa.string()) for name in ("key", "reason"))
        parts = pc.if_else(pc.starts_with(keys, "t3_"), "post", "comment")
        sources = pa.repeat("reddit", rows.num_rows)
        return pa.table({"source": sources, "part": parts, "key": keys, "reason": reasons})

    def _is_answered(self) -> bool:
        """Whether an earlier run got an answer for everything, so that `restore` asks nothing."""
        out, removed = Layout(self.run.root).restored("reddit"), self.content.removed("reddit")
        wanted, _ = asked_for(self._folders(), out)
        done = _digest(wanted, self.content.dumps, removed) in _load(out).answered
        return done and not self.run.again

    def _folders(self) -> list[Path]:
        return [folder.path for folder in self.content.folders_of("reddit")]
