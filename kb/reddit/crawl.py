"""`kb reddit crawl`: listings of the subreddit, then every comment of every post in them.

What is nearest to a whole post goes first: stubs, then threads, then the next post's page, and
only then the next page of a listing. So `--limit N` reads no more listings than N posts need.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from kb.core import clock, signals, vocabulary
from kb.core.context import Run
from kb.core.errors import (
    Blocked,
    FatalError,
    ItemFinal,
    KbError,
    LimitReached,
    Retryable,
    Unreachable,
)
from kb.core.progress import SilentTask, Task
from kb.core.verdict import Summary
from kb.reddit import tree
from kb.reddit.authors import Scrubber, load_key
from kb.reddit.client import INFO, LISTED, ROOT, Client
from kb.reddit.state import ASKED, OUTSIDE, apply, crawled, outside, unread_parts
from kb.reddit.strip import without
from kb.store import belonging
from kb.store.frontier import Frontier, Item
from kb.store.identity import remember
from kb.store.lock import writer
from kb.store.recorder import Recorder
from kb.store.tombstones import keys as tombstones

DOWN = 3
KINDS = ("listing", "tree", "more", "thread")


class Session:
    """An open data root with a client: what crawl, refresh and reconstruct share."""

    def __init__(
        self, run: Run, frontier: Frontier, recorder: Recorder, client: Client, scrubber: Scrubber
    ) -> None:
        self.run, self.frontier, self.recorder, self.client, self.scrubber = (
            run,
            frontier,
            recorder,
            client,
            scrubber,
        )
        self.gone = tombstones(run.root, "reddit")

    def record(
        self, kind: str, endpoint: str, params: dict[str, Any], status: int, response: Any
    ) -> None:
        """Names and what was purged out, then into the raw log and the frontier."""
        self.recorder.record(
            kind, endpoint, params, status, self.scrubber.scrub(without(response, self.gone))
        )


@contextmanager
def session(run: Run, place: Path | None = None) -> Iterator[Session]:
    """Credentials and identity checked, the writer's lock held, the raw tail replayed.

    `place` is where raw answers and state go, the data root when it is not given. Raises
    MissingCredential and OtherService before anything is sent or written.
    """
    section = run.profile.section("reddit")
    for name in ("reddit_client_id", "reddit_client_secret", "kb_contact"):
        run.settings.need(name)
    facts = {"host": run.settings.kb_reddit_endpoint or ROOT} | (
        {"subreddit": section.subreddit.lower()} if place is None else {}
    )
    place = place or run.root
    with writer(place, "reddit"):
        if place == run.root:
            belonging.note(run.root, run.profile)
        remember(place, "reddit", **facts)
        frontier = Frontier(place / "state" / "reddit.sqlite")

        def spend(endpoint: str, units: int) -> Any:
            row = frontier.spend("requests" if units else "token", units, endpoint)
            return lambda outcome: frontier.outcome(row, outcome)

        try:
            client = Client(
                run.settings,
                spend,
                requests_per_minute=section.requests_per_minute,
                max_tries=section.max_tries,
                say=run.progress.say,
            )
            with Recorder(place, "reddit", frontier, apply, asked=ASKED) as recorder:
                yield Session(run, frontier, recorder, client, Scrubber(load_key(run.root)))
        finally:
            frontier.close()


def crawl(run: Run, since: datetime | None = None, until: datetime | None = None) -> Summary:
    """Read what is left. `since` and `until` bound when posts were made (UTC, since included).

    What lies outside is left out, and read by a later crawl with another span or none.
    Raises LimitReached, Blocked, Unreachable, Interrupted (exit 3), CredentialRefused and FatalError
    (exit 1); the summary so far is on the error.
    """
    with session(run) as at:
        return Crawl(at, since, until).run()


class Crawl:
    """One run over the frontier."""

    def __init__(self, at: Session, since: datetime | None, until: datetime | None) -> None:
        self.at, self.frontier = at, at.frontier
        self.since, self.until = (
            None if moment is None else moment.timestamp() for moment in (since, until)
        )
        self.section = at.run.profile.section("reddit")
        self.base = f"r/{self.section.subreddit}"
        self.gone = at.gone
        self.posts = self.comments = self.failures = 0
        self.before = self.frontier.requests()
        self.bar: Task = SilentTask()

    def run(self) -> Summary:
        """Seed, then take what is nearest to done until nothing is left."""
        self._seed()
        try:
            with self._show() as self.bar:
                while self._step():
                    signals.stop.check()
        except KbError as error:
            error.summary = self.summary()
            raise
        return self.summary()

    def _show(self) -> Task:
        return self.at.run.progress.task(
            "reddit", self.at.run.limit, "posts", waiting=lambda: self.frontier.waiting("tree")
        )

    def summary(self) -> Summary:
        """Figures of this run and what is left."""
        counts = {kind: self.frontier.counts(kind) for kind in KINDS}
        requests = self.frontier.requests()[0] - self.before[0]
        left_out, in_all = outside(self.frontier), crawled(self.frontier)
        left = vocabulary.left_by("reddit", counts)
        return Summary(
            command="reddit crawl",
            source="reddit",
            counted="posts",
            crawled=self.posts,
            crawled_in_all=in_all,
            missing=counts["tree"].get("skipped", 0) - left_out,
            failed=sum(counts[kind].get("error", 0) for kind in KINDS),
            incomplete_posts=len(unread_parts(self.frontier)),
            pending=self.frontier.waiting("tree"),
            comments=self.comments,
            outside=left_out,
            posts=sum(counts["tree"].values()),
            requests=requests,
            left=sum(left.values()),
            left_by=left,
        )

    def _seed(self) -> None:
        names = []
        for listing in self.section.listings:
            names += (
                [f"{listing}:{span}" for span in self.section.spans]
                if listing in ("top", "controversial")
                else [listing]
            )
        names += [f"search:{word}" for word in self.section.search]
        self.frontier.add("listing", names)
        for kind in KINDS:
            self.frontier.reopen(kind, "error")
        for kind, out in (("tree", self._out_of_span), ("listing", self._behind)):
            left = [
                key
                for key, _, reason, state in self.frontier.items(kind, "skipped")
                if reason == OUTSIDE and not out(key, state)
            ]
            self.frontier.mark(kind, left, "todo")
        if self.at.run.again and not self.frontier.ready("listing"):
            for name, status, reason, state in self.frontier.items("listing", "done", "skipped"):
                if name in names and (status == "done" or reason == OUTSIDE):
                    upto = state.get("newest") if state and status == "done" else None
                    self.frontier.payload(
                        "listing", name, {"after": None, "pages": 0, "upto": upto}
                    )
                    self.frontier.mark("listing", [name], "todo")
        if not any(self.frontier.ready(kind) for kind in KINDS):
            self.at.run.progress.say("reddit: nothing left to read; --again starts a new round")

    def _out_of_span(self, key: str, state: Any) -> bool:
        """Whether a post was made outside --since/--until."""
        return tree.outside((state or {}).get("created_utc"), self.since, self.until)

    def _behind(self, key: str, state: Any) -> bool:
        """Whether all that a listing still has is older than --since."""
        return key == "new" and tree.outside((state or {}).get("oldest"), self.since, None)

    def _step(self) -> bool:
        """One request, whatever is nearest to a whole post. False when nothing is left."""
        more = self.frontier.take("more", INFO)
        if more:
            # One call reads one post's stubs; the rest goes back.
            post = more[0].payload["post"]
            self.frontier.release(
                "more", *(item.key for item in more if item.payload["post"] != post)
            )
            self._more(post, [item.key for item in more if item.payload["post"] == post])
            return True
        for kind in ("thread", "tree", "listing"):
            for item in self.frontier.take(kind):
                if kind == "tree" and self._left_out(item):
                    return True
                if (
                    kind == "tree"
                    and self.at.run.limit is not None
                    and self.posts >= self.at.run.limit
                ):
                    self.frontier.release(kind, item.key)
                    raise LimitReached(
                        f"{self.posts} posts were read (--limit {self.at.run.limit})",
                        hint="run the same command to go on",
                    )
                {"thread": self._thread, "tree": self._tree, "listing": self._listing}[kind](item)
                return True
        return False

    def _listing(self, item: Item) -> None:
        state = item.payload or {"after": None, "pages": 0}
        if self._behind(item.key, state):
            self.frontier.skip("listing", item.key, OUTSIDE)
            return
        name, _, extra = item.key.partition(":")
        params: dict[str, Any] = {"limit": LISTED, "raw_json": 1}
        if name == "search":
            params |= {"q": extra, "restrict_sr": 1, "sort": "new", "syntax": "lucene", "t": "all"}
        elif extra:
            params["t"] = extra
        if state.get("after"):
            params |= {"after": state["after"], "count": 100 * state["pages"]}
        endpoint = f"{self.base}/{name}"
        try:
            answer = self._wait(lambda: self.at.client.get(endpoint, params))
        except ItemFinal as error:
            if name == "search":
                self.frontier.skip("listing", item.key, error.reason)
                return
            why = {
                "forbidden": "is private or quarantined",
                "not_found": "does not exist or is banned",
                "redirect": "does not exist",
            }.get(error.reason, f"can't be read ({error.reason})")
            raise FatalError(
                f"{self.base} {why}", hint="check [reddit] subreddit in the profile"
            ) from None
        except Retryable as error:
            self._failed("listing", [item.key], error)
            return
        span = {
            name: moment
            for name, moment in (("since", self.since), ("until", self.until))
            if moment is not None
        }
        self.at.record("listings", endpoint, {**params, **span}, 200, answer)

    def _left_out(self, item: Item) -> bool:
        """Whether a post is not to be read: it lies outside of the span, or was purged."""
        why = (
            OUTSIDE
            if self._out_of_span(item.key, item.payload)
            else "purged"
            if f"t3_{item.key}" in self.gone
            else ""
        )
        if why:
            self.frontier.skip("tree", item.key, why)
        return bool(why)

    def _tree(self, item: Item) -> None:
        self._page("tree", item, {"article": item.key})
        self.posts += 1
        self._told()

    def _told(self, n: int = 1) -> None:
        """`n` items of the bar are done; what was asked for them stands beside it."""
        requests = self.frontier.requests()[0] - self.before[0]
        self.bar.advance(n, comments=self.comments, requests=requests)

    def _thread(self, item: Item) -> None:
        post, _, comment = item.key.partition("/")
        self._page("thread", item, {"article": post, "comment": comment})

    def _page(self, kind: str, item: Item, about: dict[str, Any]) -> None:
        endpoint = f"comments/{about['article']}" + (
            f"/_/{about['comment']}" if "comment" in about else ""
        )
        params = {"limit": 500, "sort": "old", "raw_json": 1}
        status, answer = 200, None
        try:
            answer = self._wait(lambda: self.at.client.get(f"{endpoint}/", params))
        except ItemFinal as error:
            status = {"not_found": 404, "forbidden": 403, "gone": 410, "legal": 451}.get(
                error.reason, 302
            )
        except Retryable as error:
            self._failed(kind, [item.key], error)
            return
        try:
            self.at.record("comments", endpoint, {**params, **about}, status, answer)
            self.comments += tree.new_comments(answer, about.get("comment"))
        except RecursionError:  # a caller that is deep in calls itself; nothing was written yet
            self._failed(
                kind, [item.key], Retryable(f"an answer nested too deep to be read at {endpoint}")
            )

    def _more(self, post: str, keys: list[str]) -> None:
        data = {
            "link_id": f"t3_{post}",
            "children": ",".join(keys),
            "api_type": "json",
            "sort": "old",
            "raw_json": 1,
        }
        try:
            answer = self._wait(lambda: self.at.client.post("api/morechildren/", data))
        except Retryable as error:
            self._failed("more", keys, error)
            return
        except ItemFinal as error:
            self.frontier.mark("more", keys, "error", error.reason)
            return
        self.at.record("morechildren", "api/morechildren", data, 200, answer)
        self.comments += tree.new_comments(answer)
        self._told(0)

    def _failed(self, kind: str, keys: list[str], error: Retryable) -> None:
        """The next run tries these again. A service that fails for one item after the other is down."""
        self.frontier.mark(kind, keys, "error", error.reason)
        self.failures += 1
        if self.failures >= DOWN:
            raise Unreachable(
                f"Reddit failed for {self.failures} items in a row ({error.reason})",
                hint="run the same command later: it goes on where it stopped",
            )

    def _wait(self, call: Any) -> Any:
        answer = patient(self.at.run, call)
        self.failures = 0
        return answer


def patient(run: Run, call: Any) -> Any:
    """The result of `call`; with --wait, sleeps through what the service asks and tries again."""
    while True:
        try:
            return call()
        except Blocked as error:
            if not run.wait or error.after is None:
                raise
            run.progress.say(f"waiting {error.after:.0f} s: {error}")
            clock.sleep(error.after)
