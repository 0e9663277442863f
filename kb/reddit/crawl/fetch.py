"""What is asked of Reddit for each kind of item. Names and what was purged leave an answer
first.
"""

from collections.abc import Callable, Collection
from typing import Any

from kb.core.errors import FatalError, ItemFinal
from kb.crawl.connector import Answer
from kb.reddit.crawl.client import LISTED, Client
from kb.reddit.crawl.discover import Span
from kb.reddit.crawl.errors import REDIRECT, STATUS, no_subreddit, too_deep
from kb.reddit.crawl.reduce import ListingCursor
from kb.reddit.parse.anonymize import Scrubber
from kb.reddit.parse.people import theirs
from kb.reddit.parse.remove_ids import without, without_asked
from kb.store.rawlog.rawlog import Request
from kb.store.state.frontier import Item

Asked = tuple[Answer | None, Collection[str]]


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
