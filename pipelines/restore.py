"""Restore (MineDojo paper, datasheet: distribution): a release has ids and structure; whoever
downloads it brings the content back with keys of their own.

    videos, transcripts    by id, as a crawl of known ids; no stage judges them again
    posts, comments        by full name with a key, or out of archive dumps
    texts of the pairs     cut out of the restored transcripts
    missing                what could not be had, and why; what was removed is never asked for
"""

from functools import partial
from typing import cast

from kb.artifacts.restore import RestoreJob, choose, write_missing
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary import plan as planned
from kb.crawl.job import Parts
from kb.filters.filter_run import run_clean
from kb.pairs.restore import TextRestore
from kb.reddit.dumps.files import Dumps
from kb.reddit.dumps.find_dumps import find_dumps
from kb.registry import SOURCES
from kb.release.folders import Folders, keep_profile, verify
from kb.store import lock
from kb.store.layout import Layout
from kb.youtube.restore import VideoRestore

ROWS = (
    *("videos", "transcripts", "posts", "comments", "pairs", "filled", "differing"),
    *(short for source in SOURCES.values() for short in source.declared.tables),
)


def restore(run: Run, folders: Folders, dumps: Dumps = (), only: str | None = None) -> Summary:
    """Bring everything back into `restored/` of the data root; after a kill the same call resumes.

    Raises SettingError and MissingCredential before anything is sent, DamagedData where a folder
    differs from its checksums; Stopped, with what was done, when something is left.
    """
    jobs = _jobs(run, folders, find_dumps(run, dumps).files, only)
    needed: tuple[str, ...] = ()
    for job in jobs:
        needed = job.check_settings(needed)
    run.settings.require(*needed)
    verify(run, folders)
    parts = Parts("restore", ROWS)
    wanted = [job for job in jobs if job.wanted]
    if not wanted:
        run.progress.say("these folders are complete: there is nothing to restore")
        return parts.summary
    run.root.mkdir(parents=True, exist_ok=True)
    with lock.taking(run.root, "restored"):
        keep_profile(run.root, folders)
        for job in wanted:
            parts.take(job.restore)
        missing = write_missing(run.root, jobs)
    parts.summary |= {"missing": missing, "path": str(Layout(run.root).restored())}
    return parts.finish()


def plan(run: Run, folders: Folders, dumps: Dumps = (), only: str | None = None) -> Summary:
    """What would be asked, of whom, with which key, after the checks of `restore`. Sends and writes
    nothing.
    """
    jobs = _jobs(run, folders, find_dumps(run, dumps).files, only)
    verify(run, folders)
    return Summary(planned.join("restore", [job.plan() for job in jobs]))


def _jobs(run: Run, folders: Folders, dumps: Dumps, only: str | None) -> tuple[RestoreJob, ...]:
    """One job a source; texts of pairs come last, as they are cut out of transcripts."""
    content = choose(folders, only)._replace(dumps=dumps)
    clean = partial(run_clean, restored=True)
    jobs = {
        name: source.restoring(run, content, clean)
        for name, source in SOURCES.items()
        if source.declared.restored
    }
    videos = cast("VideoRestore", jobs["youtube"])
    return *jobs.values(), TextRestore(run, content, videos.left)
