"""The interface of a connector: phases, answers, and the methods that a crawl calls."""

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from kb.core import clock
from kb.core.config.section import QuestionCost
from kb.core.context import Run
from kb.core.errors import Retryable, SettingError
from kb.core.summary import Summary
from kb.crawl.quota import Quota
from kb.crawl.share import Part
from kb.net.retry import PATIENCE_S, TRIES, Note, attempt, blocked
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier, Item


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One kind of frontier items, and how they are worked on.

    kind      the items' kind in the frontier
    unit      what one item is, in the plural, for people: "videos"
    name      what its progress is called; its kind when not given
    feeds     the kinds that its answers add items to
    batch     how many items one fetch takes at most
    workers   how many fetches may run at once
    service   phases of one service share its threads; services run in parallel
    bucket    phases of one bucket stop together when its quota is spent
    limited   `--limit` counts these items
    seeks     at the limit, the phases that feed it continue until one more item is found, to tell
              a limited run from a complete one; otherwise they stop at the limit too
    waits     starts only when the phases that feed it are done
    packed    waits for a full batch while its own service may find more items
    down      how many failures in a row mean that the service is down
    shown     has a progress bar
    """

    kind: str
    unit: str
    name: str = ""
    feeds: tuple[str, ...] = ()
    batch: int = 1
    workers: int = 1
    service: str = "main"
    bucket: str = ""
    limited: bool = False
    seeks: bool = False
    waits: bool = False
    packed: bool = False
    down: int = 3
    shown: bool = True


@dataclass(frozen=True)
class Answer:
    """One answer of the service, to be recorded under a raw kind.

    `failed` is the reason when the service could not deliver the item this time: the answer is
    recorded and counts as a failure. `complete`: everything that belongs to the item was requested
    and answered, so that a block is over.
    """

    kind: str
    endpoint: str
    params: dict[str, Any]
    response: Any
    status: int = 200
    failed: str | None = None
    complete: bool = True


_SEEDS_AT_ONCE = 10_000


def seed_requests(
    frontier: Frontier, kind: str, name: str, keys: Iterable[str], before: str = ""
) -> Iterator[dict[str, Any]]:
    """Parameters that list these keys under `name`, as many as an envelope may have, without those
    that the frontier knows; there `before` stands before a key.
    """
    new = (key for key in keys if frontier.get(kind, before + key) is None)
    while some := list(islice(new, _SEEDS_AT_ONCE)):
        yield {name: some}


Result = TypeVar("Result")


@dataclass(kw_only=True)
class Opened:
    """What a connector may use of its open data root. A crawl's session is one; this is of one
    that asks alone, outside of a crawl. Thread-safe.

    `purged` has the keys of purged items.
    """

    run: Run
    frontier: Frontier
    purged: set[str] = field(default_factory=set)
    _spent: tuple[int, int] = (0, 0)

    def requests(self) -> tuple[int, int]:
        """(requests, units) of this run."""
        requests, units = self.frontier.requests()
        return requests - self._spent[0], units - self._spent[1]

    def probing(self, service: str) -> bool:
        """Whether the first refusal ends the work on a service, as it blocked us before."""
        return False

    def refuse_blocked(self, service: str) -> None:
        """Call before a request. Raises Blocked or Challenged when another thread met it."""

    def sleep(self, service: str, seconds: float) -> None:
        """Wait between two attempts. Raises what ended the service meanwhile, and Interrupted."""
        clock.sleep(seconds)

    def spend(self, quota: Quota, endpoint: str, units: int = 1) -> Note:
        """Write the ledger's row of a request that is about to be sent; what notes its outcome.
        Raises QuotaSpent.
        """
        return partial(self.frontier.outcome, quota.spend(self.frontier, endpoint, units))

    def attempt(self, service: str, send: Callable[[], Result], tries: int = TRIES) -> Result:
        """What `send` returns, after several tries; with --wait, as late as the service asks.
        Raises what `send` and `kb.net.retry.attempt` raise.
        """

        def probe() -> Result:
            self.refuse_blocked(service)
            try:
                return send()
            except Retryable as error:
                if error.throttled and self.probing(service):
                    why = f"the service still rejects requests ({error})"
                    raise blocked(why, error.after) from None
                raise

        patience = math.inf if self.run.wait else PATIENCE_S
        return attempt(probe, tries=tries, patience=patience, sleep=partial(self.sleep, service))


@contextmanager
def asking(run: Run, cost: QuestionCost) -> Iterator[Opened]:
    """For one question to a service outside of a crawl, whose requests are counted in `cost`."""
    with (
        tempfile.TemporaryDirectory() as place,
        closing(Frontier(Path(place) / "ledger.sqlite")) as frontier,
    ):
        try:
            yield Opened(run=run, frontier=frontier)
        finally:
            cost.requests = frontier.requests()[0]


class Connector:
    """What crawls one source, to inherit from. It keeps its own state; the frame calls it from the
    threads of its services.

    name       the folder under raw/, the file under state/
    phases     of a crawl, in order of priority: nearest to a complete item first; they also request
               again what damaged raw data contained
    payloads   the type of each kind's payload in the frontier; kinds without payload are left out
    asked      of a crawl: which options bound what it collects; `kb update` keeps to them
    """

    name: str
    phases: Sequence[Phase]
    payloads: Mapping[str, type[msgspec.Struct]] = {}
    asked: Mapping[str, str] | None = None
    opened: Opened

    def identity(self) -> dict[str, str]:
        """Hosts, subreddit or wiki that the data root is bound to.

        Raises UsageError when a setting that every request needs is missing.
        """
        raise NotImplementedError

    def restrict(self, keys: Sequence[str] | None, part: Part) -> None:
        """Crawl these keys instead of what the service lists, and one machine's share of all.
        Raises SettingError where the source can't.
        """
        if keys is not None or part is not None:
            option = "--ids" if keys is not None else "--part"
            raise SettingError(f"{self.name} has no {option}", hint="leave it out")

    def refresh(self, days: int) -> None:
        """Read again what is older than so many days, instead of a crawl. Of sources that declare
        what is refreshed.
        """
        raise NotImplementedError

    def plan(self, command: str, kinds: Sequence[str] = ()) -> Summary:
        """What is left of `kinds`, by default of all. Raises SettingError where nobody can say."""
        raise SettingError(f"{self.name} has no --plan", hint="leave it out")

    def begin(self, opened: Opened) -> None:
        """The data root is open; before the raw tail is replayed. Sends nothing."""
        self.opened = opened

    def seeds(self, frontier: Frontier) -> Iterator[dict[str, Any]]:
        """What a list names that the frontier does not know, as parameters of requests to record
        (`rawlog.SEEDS`), which `reduce` then adds. Sends nothing.
        """
        return iter(())

    def discover(self, frontier: Frontier) -> None:
        """Add the seeds, and what a new round starts with. Sends nothing."""
        raise NotImplementedError

    def leave_out(self, phase: Phase, item: Item) -> str | None:
        """Why an item is not to be asked for; None when it is, as by default."""
        return None

    def pack(self, phase: Phase, items: list[Item]) -> list[Item]:
        """Those of the items that one fetch can take together, by default all; the others wait."""
        return items

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """Ask for the items. Raises what kb.core.errors sorts by consequence."""
        raise NotImplementedError

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """Take an answer into the frontier; the same live and in a replay, so idempotent."""
        raise NotImplementedError

    def advice(self, phase: Phase, reason: str) -> str:
        """What to do when every item of a phase failed, most of them for this reason."""
        return "the same command tries again what failed"

    def close(self) -> None:
        """Close connections and programs."""
