"""Reddit as a source of the crawl frame: phases, and `kb reddit crawl`.

Work that completes a post goes first: stubs, then threads, then the next post's page, and only then
the next page of a listing. So `--limit N` reads no more listings than N posts need.
"""

from collections.abc import Callable, Iterator
from datetime import datetime

from kb.core.cached_property import cached_property
from kb.core.config.profile.collecting import RedditSection
from kb.core.context import Run
from kb.core.errors import ItemFinal
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Connector, Opened, Phase
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.reddit.crawl import discover, reduce
from kb.reddit.crawl.client import IDS, ROOT, Client
from kb.reddit.crawl.discover import KINDS
from kb.reddit.crawl.errors import require
from kb.reddit.crawl.fetch import RedditFetcher
from kb.reddit.crawl.reduce import crawled, outside
from kb.reddit.dumps.cursor import recover_segments
from kb.reddit.parse import answer_tree
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.reddit.source import Reddit
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier, Item

MORE = Phase(kind="more", unit="further comments", feeds=("more", "thread"), batch=IDS, shown=False)
THREAD = Phase(kind="thread", unit="deep threads", feeds=("more", "thread"), shown=False)
TREE = Phase(
    kind="tree",
    unit="posts",
    name="reddit",
    feeds=("more", "thread"),
    limited=True,
    seeks=True,  # of a span of time most posts may be left out
)
LISTING = Phase(kind="listing", unit="listings", feeds=("tree", "listing"), shown=False)
# Things asked for by name: by a refresh and a reconstruction.
INFO = Phase(kind="info", unit="posts and comments", batch=IDS, limited=True)


class RedditConnector(Connector):
    """The crawl of a subreddit. `since` and `until` bound the dates of posts (UTC, since included).

    `comments` counts the comments that this run has read.
    """

    name = "reddit"
    phases: tuple[Phase, ...] = (MORE, THREAD, TREE, LISTING)
    payloads = reduce.PAYLOADS

    def __init__(
        self, run: Run, since: datetime | None = None, until: datetime | None = None
    ) -> None:
        self.run, self.section = run, run.profile.section(RedditSection)
        self.span = discover.Span(
            since.timestamp() if since else None, until.timestamp() if until else None
        )
        self.comments = 0

    def identity(self) -> dict[str, str]:
        """The host and the subreddit. Raises MissingCredential."""
        require(self.run)
        host = self.run.settings.kb_reddit_endpoint or ROOT
        return {"host": host, "subreddit": self.section.subreddit.lower()}

    def begin(self, opened: Opened) -> None:
        """Recover interrupted imports before raw answers are replayed."""
        super().begin(opened)
        self.settle()

    def settle(self) -> None:
        """Complete the segments of a killed import."""
        recover_segments(self.run.root)

    def discover(self, frontier: Frontier) -> None:
        """The profile's listings; with --again a new round of them."""
        if not discover.seed(frontier, self.section, self.span, new_round=self.run.again):
            self.run.progress.say("reddit: nothing left to read; --again starts a new round")

    def leave_out(self, phase: Phase, item: Item) -> str | None:
        """Posts outside of the span, and purged things."""
        if phase.kind == "tree":
            if self.span.excludes(item.payload):
                return reduce.OUTSIDE
            return "purged" if f"t3_{item.key}" in self.opened.purged else None
        if phase.kind == "listing" and self.span.is_behind(item.key, item.payload):
            return reduce.OUTSIDE
        return "purged" if phase.kind == "info" and item.key in self.opened.purged else None

    def pack(self, phase: Phase, items: list[Item]) -> list[Item]:
        """One call reads one post's stubs."""
        if phase.kind != "more":
            return items
        return [item for item in items if item.payload.post == items[0].payload.post]

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """One listing's page, one post's page, one thread, one post's stubs, or up to 100 names."""
        try:
            answer, purged = self._fetch.ask(phase.kind, items)
        except ItemFinal as fact:
            if phase.kind != "more":
                raise
            # The comments exist, so this is not final: another run tries again.
            keys = [item.key for item in items]
            self.opened.frontier.mark(phase.kind, keys, "error", fact.reason)
            return
        if answer is not None:
            yield answer
            if answer.kind in ("comments", "morechildren"):
                of = answer.params.get("comment")
                self.comments += answer_tree.new_comments(answer.response, of)
        # What people posted who asked to be left out is told by the answer only.
        theirs = [one.key for one in items if reduce.fullname(phase.kind, one.key) in purged]
        if theirs:
            self.opened.frontier.mark(phase.kind, theirs, "skipped", "purged")

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """As kb.reddit.crawl.reduce."""
        reduce.reduce(frontier, kind, envelope)

    @cached_property
    def _fetch(self) -> RedditFetcher:
        """Made with the first request: an import sends none."""
        frontier = self.opened.frontier

        def spend(endpoint: str, units: int) -> Callable[[str], None]:
            row = frontier.spend("requests" if units else "token", units, endpoint)
            return lambda outcome: frontier.outcome(row, outcome)

        client = Client(
            self.run.settings,
            spend,
            requests_per_minute=self.section.requests_per_minute,
            max_tries=self.section.max_tries,
            say=self.run.progress.say,
        )
        people = tombstones.people(self.run.root, self.name)
        scrubber = Scrubber(load_key(self.run.root), people)
        return RedditFetcher(
            client, scrubber, self.opened.purged, self.section.subreddit, self.span
        )


class Dumps(RedditConnector):
    """The import of dumps, which sends no requests."""

    def identity(self) -> dict[str, str]:
        """The subreddit."""
        return {"subreddit": self.section.subreddit.lower()}


def crawl(run: Run, since: datetime | None = None, until: datetime | None = None) -> Summary:
    """Crawl listings of the subreddit, then all comments of their posts. `since` and `until` bound
    the dates of posts (UTC, since included).

    Posts outside are skipped; a later crawl with another span or none reads them.
    Raises LimitReached, Blocked, Unreachable, Interrupted (exit 3), CredentialRefused and
    FatalError (exit 1); the summary so far is on the error.
    """
    source = RedditConnector(run, since, until)

    def summary(session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {kind: frontier.counts(kind) for kind in KINDS}
        left = Reddit.left_by(counts)
        left_out = outside(frontier)
        return Summary(
            command="reddit crawl",
            source="reddit",
            counted="posts",
            crawled=loop.answered["tree"],
            crawled_in_all=crawled(frontier),
            missing=counts["tree"].get("skipped", 0) - left_out,
            failed=sum(counts[kind].get("error", 0) for kind in KINDS),
            incomplete_posts=len(reduce.incomplete_posts(frontier)),
            pending=frontier.waiting("tree"),
            comments=source.comments,
            outside=left_out,
            posts=sum(counts["tree"].values()),
            requests=session.requests()[0],
            left=sum(left.values()),
            left_by=left,
        )

    return work(
        run,
        source,
        summary,
        facts=lambda phase: {
            "comments": source.comments,
            "requests": source.opened.requests()[0],
        },
    )
