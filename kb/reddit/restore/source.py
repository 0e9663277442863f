"""The crawl of a reconstruction: known ids and whole trees, into its work folder."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from kb.core.context import Run
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Phase
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.reddit.crawl.connector import INFO, MORE, THREAD, TREE, RedditConnector
from kb.reddit.crawl.ids import WantedThings
from kb.reddit.crawl.reduce import PAYLOADS
from kb.reddit.source import Reddit
from kb.store.state.frontier import Frontier, Item
from kb.store.tables import reading

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
        return {"requests": self.opened.requests()[0]}

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """Figures of this run and what is left."""
        frontier = session.frontier
        counts = {phase.kind: frontier.counts(phase.kind) for phase in self.phases}
        left = Reddit.left_by(counts)
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
