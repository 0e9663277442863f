"""`kb reddit reconstruct`: full posts and comments again from ids, with the user's own key or out
of archive dumps.

Known ids go through `info`, 100 full names a request, posts and comments together. Posts of the
published `reddit.json` have no comment ids: their whole trees are read, with every nested reply.
Answers wait in a work folder until every id is answered, so a run that was cut off asks again only
for what was in flight; then they are added to the tables and the work folder goes. What other runs
brought into the same folder stays (kb.reddit.earlier).

    out/posts/*.parquet  out/comments/*.parquet     the clean tables' columns, scores of models null
    out/missing.parquet                             key, reason: missing, deleted, removed, purged,
                                                    forbidden, malformed, failed, not in these
                                                    dumps; and when the source said so
"""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.profile import DEFAULT, load_profile
from kb.core.profile.reddit import RedditSection
from kb.core.settings import load_settings
from kb.core.verdict import Summary
from kb.crawl import job
from kb.net import redact
from kb.reddit import byid, credentials, dumpfiles, earlier, places, tables
from kb.reddit.again import Rebuild, unanswered
from kb.reddit.authors import load_key
from kb.reddit.importing import different, import_jobs, summary_of
from kb.reddit.onedump import ImportJob
from kb.reddit.wanted import Ids, WantedThings, asked_for, released, subreddit_of
from kb.store import leftovers, parquet, tombstones
from kb.store.layout import Layout
from kb.store.lock import writer

LOCK = ".lock"  # in a folder of tables outside of the data root: one run at a time adds to them
NOT_THERE = "not in these dumps"
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
    has already is added to, and comes as well. `settings` are names of kb.core.settings
    (`reddit_client_id="…"`, `kb_data="…"`); the environment and `.env` count as for the command.
    Everything is read first (cut off, the same call goes on), then posts, comments and what is
    missing come in order. Raises as `rebuild`.
    """
    run = run or _run(profile, settings)
    place = Path(out) if out else Layout(run.root).reconstructed
    rebuild(run, ids, place, dumps=[Path(file) for file in dumps])
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


def rebuild(
    run: Run,
    ids: Ids,
    out: Path,
    *,
    dumps: Sequence[Path] = (),
    gone: Collection[str] = (),
) -> Summary:
    """Read everything, add it to the tables in `out`. With `--again` what was answered before is
    read anew.

    `dumps` are read instead of asking Reddit. `gone` are full names that were purged elsewhere:
    like the data root's own tombstones they are never asked for. Raises SettingError (also where
    the tables would take the place of other files) and MissingCredential before anything is sent
    (exit 2); LimitReached, Blocked, Unreachable and Interrupted (exit 3; the same command goes
    on); CredentialRefused and WriterLocked (exit 1).
    """
    if dumps:
        dumps = dumpfiles.find(run, dumps).files
    else:
        credentials.require(run, without=WITHOUT_KEY)
    wanted, sources = asked_for(ids, Layout(run.root).release("reddit"), run.progress.say)
    digest = _digest(wanted, dumps, gone)
    tables.check_place(out)
    with _writer(run.root, out):
        for name in (earlier.DONE, earlier.MISSING):
            leftovers.ended(out / name)  # of a killed run
        earlier.settle(out)
        done, work = earlier.load(out), out / f"{tables.WORK}{digest}"
        if digest in done.answered and not run.again:
            shutil.rmtree(work, ignore_errors=True)
            said = "these dumps were read" if dumps else "every id was answered"
            run.progress.say(f"{out}: {said} before; --again reads them anew")
            return Summary(**{**done.answered[digest], **_counts(out, done), "requests": 0})
        stale = earlier.begin(work, done)
        gone = {*gone, *tombstones.keys(run.root, "reddit")}
        answers = tables.Answers(work, wanted, {}, released(sources), stale, gone)
        if dumps:
            subreddit = "" if wanted.trees else subreddit_of(sources)
            summary = _read_dumps(run, wanted, dumps, work, gone, subreddit)
            answers = answers._replace(stale=True, otherwise=NOT_THERE)
        else:
            source = Rebuild(run, wanted, gone)
            summary = job.work(run, source, source.summary, place=work, facts=source.facts)
            left = unanswered(Layout(work).state("reddit"))
            answers = answers._replace(unanswered=left)
        if wanted.bad_lines:
            summary["bad_lines"] = summary.get("bad_lines", 0) + wanted.bad_lines
        try:
            done.answered.pop(digest, None)
            done.counts = tables.write(answers, out, run.profile.section(RedditSection).links)
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


def _writer(root: Path, out: Path) -> AbstractContextManager[None]:
    """The right to add to the tables in `out`: a lock of the data root where they lie in it."""
    at = Layout(root)
    if out == at.reconstructed:
        return writer(root, "reconstructed")
    if out.is_relative_to(at.restored()):
        return writer(root, "restored")
    return writer(out / LOCK, "reddit")


def _digest(wanted: WantedThings, dumps: Sequence[Path], gone: Collection[str]) -> str:
    """Tells what is wanted, of which dumps, and without what, from anything else."""
    if not dumps and not gone:
        return wanted.digest()
    names = [*sorted(places.name_of(file, 0.0, math.inf) for file in dumps), *sorted(gone)]
    return hashlib.sha256(" ".join([wanted.digest(), *names]).encode()).hexdigest()[:16]


def _read_dumps(
    run: Run,
    wanted: WantedThings,
    dumps: Sequence[Path],
    work: Path,
    gone: Collection[str],
    subreddit: str,
) -> Summary:
    """What is wanted of the dumps → raw answers in the work folder, as an import writes them.

    `subreddit` is that of all ids, "" where nobody knows.
    """
    ids, notes = work / "ids", Layout(work).importing("reddit")
    if run.again and not notes.exists():
        run = replace(run, again=False)  # nothing was read yet that could be read anew
    places.settle(work)
    load_key(run.root)
    if not ids.is_dir():
        with run.progress.task("ids", unit="steps"):
            byid.keep(wanted.names, wanted.trees, ids, gone)
    room, home = run.limit or 0, str(run.root)
    job_ = ImportJob(str(work), "", subreddit, 0.0, math.inf, room, ids=str(ids), home=home)
    files = different(run, dumps)
    jobs = [msgspec.structs.replace(job_, file=str(file.absolute())) for file in files]
    try:
        summary = summary_of(import_jobs(replace(run, root=work), jobs))
    except KbError as error:
        if error.summary is not None:
            error.summary = _of_dumps(error.summary)
        raise
    return _of_dumps(summary)


def _of_dumps(summary: Mapping[str, Any]) -> Summary:
    return Summary({**summary, "command": "reddit reconstruct", "failed": 0, "pending": 0})


def _counts(out: Path, done: earlier.Done) -> dict[str, int]:
    """Rows of the tables as they are now; what failed is not `missing`, as it is asked for
    again.
    """
    failed = sum(one.reason == "failed" for one in earlier.missing(out).values())
    return {
        **{name: done.counts[name] for name in earlier.NAMES},
        "missing": done.counts[earlier.MISSING] - failed,
    }


def _run(profile: str | None, settings: dict[str, Any]) -> Run:
    loaded = load_settings(**{**settings, "kb_profile": profile or settings.get("kb_profile")})
    redact.know(loaded.secret_values())
    return Run(
        settings=loaded,
        profile=load_profile(loaded.kb_profile or DEFAULT),
        root=loaded.kb_data.expanduser().absolute(),
    )
