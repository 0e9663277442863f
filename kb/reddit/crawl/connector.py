"""Reddit as a source of the crawl: phases, what is asked for each kind of item, `kb reddit crawl`.
Names and what was purged leave an answer first.

Work that completes a post goes first: stubs, then threads, then the next post's page, and only then
the next page of a listing. So `--limit N` reads no more listings than N posts need.
"""

from collections.abc import Callable, Collection, Iterator
from datetime import datetime
from typing import Any

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.core.context import Run
from kb.core.errors import FatalError, ItemFinal, Retryable
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Phase
from kb.crawl.job import work
from kb.crawl.limits import check_length
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.reddit.crawl import reduce
from kb.reddit.crawl.client import LISTED, ROOT, Client
from kb.reddit.crawl.errors import REDIRECT, STATUS, no_subreddit, require, too_deep
from kb.reddit.crawl.reduce import KINDS, ListingCursor, Span, crawled, outside
from kb.reddit.crawl.subreddit import Subreddit
from kb.reddit.parse import answer_tree
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.reddit.parse.answer_tree import theirs
from kb.reddit.parse.remove_ids import without, without_asked
from kb.store.rawlog.rawlog import Request
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier, Item

Asked = tuple[Answer | None, Collection[str]]
PARTS = 5_000  # requests for the comments of one post; each gives up to some hundreds


class RedditFetcher:
    """Asks by one client. `purged` are full names."""

    def __init__(
        self,
        client: Client,
        scrubber: Scrubber,
        purged: Collection[str],
        subreddit: str,
        span: Span,
    ) -> None:
        self._client, self._scrubber, self._purged = client, scrubber, purged
        self._base, self._span = f"r/{subreddit}", span

    def ask(self, kind: str, items: list[Item]) -> Asked:
        """The answer for items of one kind, as many as one request takes, and the full names in it
        of people who asked to be left out; None when it was about these alone. Raises as
        kb.reddit.crawl.errors says.
        """
        ways: dict[str, Callable[[list[Item]], Asked]] = {
            "listing": self._listing,
            "tree": self._page,
            "thread": self._page,
            "more": self._more,
            "info": self._info,
        }
        return ways[kind](items)

    def is_shut(self) -> bool:
        """Whether the subreddit itself can't be had: it is private, barred or banned."""
        try:
            self._client.get(f"{self._base}/new", {"limit": 1, "raw_json": 1})
        except ItemFinal:
            return True
        return False

    def _listing(self, items: list[Item]) -> Asked:
        """The next page of a listing; the span goes into the record, as it says what is
        left out.
        """
        (item,) = items
        state: ListingCursor = item.payload or ListingCursor()
        name, _, extra = item.key.partition(":")
        params: dict[str, Any] = {"limit": LISTED, "raw_json": 1}
        if name == "search":
            params |= {"q": extra, "restrict_sr": 1, "sort": "new", "syntax": "lucene", "t": "all"}
        elif extra:
            params["t"] = extra
        if state.after:
            params |= {"after": state.after, "count": 100 * state.pages}
        endpoint = f"{self._base}/{name}"
        try:
            answer = self._client.get(endpoint, params)
        except ItemFinal as fact:
            if name == "search":
                raise
            raise no_subreddit(self._base, fact) from None
        bounds = {name: at for name, at in self._span._asdict().items() if at is not None}
        return self._answer("listings", endpoint, {**params, **bounds}, answer)

    def _page(self, items: list[Item]) -> Asked:
        """A post with its comments, or a comment's thread; that it is gone or shut is an answer
        too.
        """
        (item,) = items
        post, _, comment = item.key.partition("/")
        about = {"article": post, "comment": comment} if comment else {"article": post}
        endpoint = f"comments/{post}/_/{comment}" if comment else f"comments/{post}"
        params = {"limit": 500, "sort": "old", "raw_json": 1}
        status, answer = 200, None
        try:
            answer = self._client.get(f"{endpoint}/", params)
        except ItemFinal as fact:
            status = STATUS.get(fact.reason, REDIRECT)
        return self._answer("comments", endpoint, {**params, **about}, answer, status)

    def _more(self, items: list[Item]) -> Asked:
        """Comments behind the stubs of one post."""
        data = {
            "link_id": f"t3_{items[0].payload.post}",
            "children": ",".join(item.key for item in items),
            "api_type": "json",
            "sort": "old",
            "raw_json": 1,
        }
        answer = self._client.post("api/morechildren/", data)
        return self._answer("morechildren", "api/morechildren", data, answer)

    def _info(self, items: list[Item]) -> Asked:
        """Posts and comments by name; with the post of each where it is known."""
        names = [item.key for item in items]
        params: dict[str, Any] = {"id": ",".join(names)}
        if items[0].payload is not None:
            params["posts"] = [item.payload.post for item in items]
        try:
            answer = self._client.info(names)
        except ItemFinal as fact:
            raise FatalError(f"Reddit does not answer info ({fact})") from None
        return self._answer("info", "api/info", params, answer)

    def _answer(
        self, kind: str, endpoint: str, params: dict[str, Any], response: Any, status: int = 200
    ) -> Asked:
        try:
            clean = self._scrubber.scrub(response)
            people = theirs(clean)
            clean = without(clean, self._purged)
        except RecursionError:  # called from deep in calls itself; nothing was written yet
            raise too_deep(endpoint) from None
        request = without_asked(kind, Request(endpoint, params), people)
        if request is None:
            return None, people
        return Answer(kind, request.endpoint, request.params, clean, status), people


class RedditConnector(Subreddit):
    """The crawl of a subreddit. `since` and `until` bound the dates of posts (UTC, since included).

    `comments` counts the comments that this run has read.
    """

    def __init__(
        self, run: Run, since: datetime | None = None, until: datetime | None = None
    ) -> None:
        super().__init__(run)
        self.span = reduce.Span(
            since.timestamp() if since else None, until.timestamp() if until else None
        )
        self.comments = 0

    def identity(self) -> dict[str, str]:
        """The host and the subreddit. Raises MissingCredential."""
        require(self.run)
        host = self.run.settings.kb_reddit_endpoint or ROOT
        return {"host": host, **super().identity()}

    def discover(self, frontier: Frontier) -> None:
        """The profile's listings; with --again a new round of them."""
        if not reduce.seed(frontier, self.section, self.span, new_round=self.run.again):
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
        if phase.kind in ("more", "thread"):
            item = items[0]
            post = item.payload.post if phase.kind == "more" else item.key.partition("/")[0]
            _, page, _ = self.opened.frontier.get("tree", post) or ("", None, None)
            read = page.parts if page is not None else 0
            try:
                check_length(f"the comments of the post {post}", read, PARTS)
            except Retryable as error:  # about this post, not about the service
                keys = [item.key for item in items]
                self.opened.frontier.mark(phase.kind, keys, "error", error.reason)
                return
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
                of = answer.params.get("comment")  # which a thread's page repeats
                self.comments += sum(
                    thing.kind == answer_tree.COMMENT and thing.data.get("id") != of
                    for thing in answer_tree.things(answer.response)
                )
        # Only the answer shows what was posted by people who asked to be left out.
        theirs = [item.key for item in items if reduce.fullname(phase.kind, item.key) in purged]
        if theirs:
            self.opened.frontier.mark(phase.kind, theirs, "skipped", "purged")

    @cached_property
    def _fetch(self) -> RedditFetcher:
        """Made with the first request."""
        client = Client(self.opened, self.section)
        people = tombstones.people(self.run.root, self.name)
        scrubber = Scrubber(load_key(self.run.root), people)
        return RedditFetcher(
            client, scrubber, self.opened.purged, self.section.subreddit, self.span
        )


def crawl(run: Run, since: datetime | None = None, until: datetime | None = None) -> Summary:
    """Crawl listings of the subreddit, then all comments of their posts. `since` and `until` bound
    the dates of posts (UTC, since included).

    Posts outside are skipped; a later crawl with another span or none reads them.
    Raises Stopped (the same command resumes), CredentialRefused and FatalError; the summary so far
    is on the error.
    """
    source = RedditConnector(run, since, until)
    source.asked = {"since": clock.stamp(since)} if since else {}

    def summary(session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {kind: frontier.counts(kind) for kind in KINDS}
        left = SOURCES["reddit"].left_by(counts)
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
