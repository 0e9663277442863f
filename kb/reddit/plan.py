"""What reading Reddit would take: a crawl, a refresh, a reconstruction. Sends nothing."""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

from kb.core.config.addresses import is_loopback
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary.plan import NOTHING_NEW, PlanPhase, plan, to_read
from kb.reddit.crawl.client import LISTED, ROOT
from kb.reddit.crawl.ids import Ids, asked_for
from kb.reddit.crawl.reduce import PAGES, PAYLOADS, is_by_time, listings
from kb.reddit.crawl.refresh import due, oldest_due
from kb.reddit.crawl.subreddit import IDS
from kb.reddit.dumps.find_dumps import find_dumps
from kb.reddit.parse.latest_state import latest_state
from kb.reddit.section import RedditSection
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.store.tables import reading

# Used only where this data root has nothing to measure.
NEW_A_LISTING = 0.25  # of a listing's posts that no other one has
REQUESTS_A_POST = 2.0  # its page, and what that only names
BYTES_A_POST = 8_000
BYTES_AN_ID = 600
DUMP_BYTES_AN_HOUR = 20e6 * 3600  # compressed, of one core


def plan_crawl(run: Run) -> Summary:
    """Listings, posts and requests that are left, by what this data root shows or by assumption."""
    kinds: dict[str, dict[str, int]] = {}
    path = Layout(run.root).state("reddit")
    section = run.profile.section(RedditSection)
    if path.is_file():
        with reading.state(path, PAYLOADS) as frontier:
            kinds = frontier.kinds()
            if run.again and kinds and not frontier.ready("listing"):
                return _next_round(run, frontier, section, kinds)
    every = len(listings(section))
    lists = to_read(kinds, "listing") if kinds.get("listing") else every
    pages, assumed = lists * PAGES, []
    fresh = round(pages * LISTED * NEW_A_LISTING)
    if lists:
        assumed.append(f"{PAGES} pages a listing, {NEW_A_LISTING:.0%} of their posts new")
    posts = to_read(kinds, "tree") + fresh
    done = kinds.get("tree", {}).get("done", 0)
    further = sum(kinds.get("more", {}).values()) / IDS + sum(kinds.get("thread", {}).values())
    per_post = 1 + further / done if done else REQUESTS_A_POST
    size = BYTES_A_POST
    if done:
        segments = rawlog.segments(run.root, "reddit", "comments")
        size = max(1, sum(segment.stat().st_size for segment in segments) // done)
    elif posts:
        assumed.append(f"{REQUESTS_A_POST:g} requests and {BYTES_A_POST // 1000} kB a post")
    asked = round(posts * per_post) + math.ceil(to_read(kinds, "more") / IDS)
    asked += to_read(kinds, "thread")
    phases = [
        PlanPhase("listings", lists, requests=pages, hours=_hours(run, pages)),
        PlanPhase("posts", posts, requests=asked, hours=_hours(run, asked), gb=posts * size / 1e9),
    ]
    return Summary(plan("reddit crawl", "reddit", phases, assumed))


def _next_round(
    run: Run, frontier: Frontier, section: RedditSection, kinds: dict[str, dict[str, int]]
) -> Summary:
    """What a new round asks for where nothing is new: the pages of each listing, of those by time
    the first one; and what was left.
    """
    names = listings(section)
    known = {key: last for key, _, _, last in frontier.items("listing") if last is not None}
    pages = sum(
        1 if is_by_time(name) and known[name].newest else known[name].pages
        for name in names
        if name in known
    ) + PAGES * sum(name not in known for name in names)
    parts = math.ceil(to_read(kinds, "more") / IDS)
    asked = to_read(kinds, "tree") + to_read(kinds, "thread") + parts
    phases = [
        PlanPhase("listings", len(names), requests=pages, hours=_hours(run, pages)),
        PlanPhase("posts", to_read(kinds, "tree"), requests=asked, hours=_hours(run, asked)),
    ]
    return Summary(plan("reddit crawl", "reddit", phases, [NOTHING_NEW]))


def plan_refresh(run: Run, older_than: int | None = None) -> Summary:
    """What a refresh would read again now. Reads all raw answers, also beside a running crawl."""
    days = run.profile.section(RedditSection).max_age_days if older_than is None else older_than
    oldest = oldest_due(days, older_than)
    with (
        tempfile.TemporaryDirectory(prefix="lorecrawl-plan-") as scratch,
        latest_state(run, Path(scratch, "known")) as things,
    ):
        purged = tombstones.keys(run.root, "reddit")
        items = sum(rows.num_rows for rows in due(things, purged, oldest, run.again))
    return Summary(_of_ids(run, "refresh reddit", "posts and comments to refresh", items))


def plan_rebuild(run: Run, ids: Ids, dumps: Sequence[Path] = ()) -> Summary:
    """What a reconstruction of these ids would ask for, or read. Raises SettingError."""
    files = find_dumps(run, dumps).files
    wanted, _ = asked_for(ids, Layout(run.root).release("reddit"))
    if dumps:
        size = sum(file.stat().st_size for file in files)
        items = len(wanted.names) + len(wanted.trees)
        hours, gb = size / DUMP_BYTES_AN_HOUR / run.workers, items * BYTES_AN_ID / 1e9
        phases = [PlanPhase("posts and comments", items, hours=hours, gb=gb)]
        assumed = [f"{DUMP_BYTES_AN_HOUR / 3600 / 1e6:g} MB of dumps a second and core"]
        return Summary(plan("reddit reconstruct", "reddit", phases, assumed))
    names, trees = len(wanted.names), len(wanted.trees)
    return Summary(_of_ids(run, "reddit reconstruct", "posts and comments", names, trees))


def _of_ids(run: Run, command: str, phase: str, items: int, trees: int = 0) -> dict[str, object]:
    """Known ids are requested 100 at a time; a tree takes requests of its own."""
    assumed = [f"{BYTES_AN_ID} bytes an id"]
    calls = math.ceil(items / IDS)
    phases = [PlanPhase(phase, items, calls, 0, _hours(run, calls), items * BYTES_AN_ID / 1e9)]
    if trees:
        calls = round(trees * REQUESTS_A_POST)
        phases.append(
            PlanPhase("posts", trees, calls, 0, _hours(run, calls), trees * BYTES_A_POST / 1e9)
        )
        assumed.append(f"{REQUESTS_A_POST:g} requests a post with its comments")
    return plan(command, "reddit", phases, assumed)


def _hours(run: Run, requests: int) -> float:
    """At the profile's pace; on loopback nothing is waited for."""
    if is_loopback(run.settings.kb_reddit_endpoint or ROOT):
        return 0.0
    return requests / run.profile.section(RedditSection).requests_per_minute / 60
