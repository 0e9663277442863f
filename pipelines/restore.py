"""Restore (MineDojo paper, datasheet: distribution): a release has ids and structure; whoever
downloads it brings the content back with keys of their own.

    videos, transcripts    by id, as a crawl of known ids; no stage judges them again
    posts, comments        by full name with a key, or out of archive dumps
    texts of the pairs     cut out of the restored transcripts
    missing                what could not be had, and why; what was removed is never asked for
"""

from __future__ import annotations

from dataclasses import replace

from kb.core import plan as planned
from kb.core.context import Run
from kb.core.pipeline import load, locate
from kb.core.profile import Profile
from kb.core.profile.youtube import YouTubeSection
from kb.core.verdict import Summary
from kb.crawl.job import Parts
from kb.filters.chain import Clean
from kb.filters.clean import run_clean
from kb.filters.released import stages
from kb.pairs import refill
from kb.reddit import dumpfiles
from kb.reddit import restored as reddit
from kb.reddit.restored import Dumps
from kb.release.downloaded import Folders, keep_profile, verify
from kb.release.missing import write_missing
from kb.release.wanted import choose
from kb.store import lock
from kb.store.layout import Layout
from kb.youtube import restored as youtube

ROWS = ("videos", "transcripts", "posts", "comments", "pairs", "filled", "differing")


def clean(p: Profile) -> Clean:
    """Raw answers to the tables of every video that is there: what is released was judged."""
    whole: Clean = load(str(locate("youtube"))).clean(p)
    chain = replace(whole.chains[0], stages=stages(p.section(YouTubeSection)), scores={}, told=())
    return replace(whole, chains=(chain,), scorer=None)


def restore(run: Run, folders: Folders, dumps: Dumps = (), only: str | None = None) -> Summary:
    """Bring everything back into `restored/` of the data root. Cut off, the same call goes on.

    Raises SettingError and MissingCredential before anything is sent, DamagedData where a folder
    is not whole; Stopped, with what was done, when something is left.
    """
    wanted, parts = choose(folders, only), Parts("restore", ROWS)
    gone = wanted.removed
    dumps = dumpfiles.find(run, dumps).files
    needed = youtube.needs(run, wanted.videos, gone["youtube"])
    reddit.check(run, wanted.reddit, dumps, needed)
    refill.check(run, wanted.pairs)
    verify(run, folders)
    if not (wanted.videos or wanted.reddit or wanted.pairs):
        run.progress.say("these folders hold everything: there is nothing to bring back")
        return parts.summary
    run.root.mkdir(parents=True, exist_ok=True)
    with lock.taking(run.root, "restored"):
        keep_profile(run.root, folders)
        if wanted.videos:
            parts.take(youtube.bring, run, wanted.videos, _sort, gone["youtube"], wanted.had)
        if wanted.reddit:
            parts.take(reddit.bring, run, wanted.reddit, dumps, gone["reddit"])
        for folder in wanted.pairs:
            parts.take(refill.restore, run, folder, gone["youtube"])
        missing = write_missing(run.root)
    parts.summary |= {"missing": missing, "path": str(Layout(run.root).restored())}
    return parts.finish()


def plan(run: Run, folders: Folders, dumps: Dumps = (), only: str | None = None) -> Summary:
    """What would be asked, of whom, with which key. Sends and writes nothing."""
    wanted = choose(folders, only)
    videos = youtube.plan(run, wanted.videos, wanted.removed["youtube"])
    parts = (videos, reddit.plan(run, wanted.reddit, dumps), refill.plan(wanted.pairs))
    return Summary(planned.join("restore", parts))


def _sort(run: Run) -> None:
    """The raw answers of a work folder → its clean tables, by `clean` above."""
    run_clean(replace(run, pipeline=str(locate("restore"))), "youtube")
