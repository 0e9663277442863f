"""A subreddit in a data root: its phases, what it is bound to, and what its answers mean.

An import of dumps opens no more than this. What asks Reddit (kb.reddit.crawl.connector) inherits
it, and loads PRAW, which takes a quarter of a second.
"""

from kb.core.context import Run
from kb.crawl.connector import Connector, Opened, Phase
from kb.reddit.crawl import reduce
from kb.reddit.dumps.cursor import recover_segments
from kb.reddit.section import RedditSection
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier

IDS = 100  # most ids of one info or morechildren call

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


class Subreddit(Connector):
    """The profile's subreddit. Sends nothing itself."""

    name = "reddit"
    phases: tuple[Phase, ...] = (MORE, THREAD, TREE, LISTING)
    payloads = reduce.PAYLOADS

    def __init__(self, run: Run) -> None:
        self.run, self.section = run, run.profile.section(RedditSection)

    def identity(self) -> dict[str, str]:
        """The subreddit."""
        return {"subreddit": self.section.subreddit.lower()}

    def begin(self, opened: Opened) -> None:
        """Recover interrupted imports before raw answers are replayed."""
        super().begin(opened)
        self.settle()

    def settle(self) -> None:
        """Complete the segments of a killed import."""
        recover_segments(self.run.root)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        reduce.reduce(frontier, kind, envelope)
