"""The connector of a service that answers in lists of JSON objects: pages, cursors, and lists of
keys that are asked for many at once.

A source says which lists there are (`ListPhase`). An answer is recorded as the raw kind of its
phase, without the key that it was asked with. `JsonService` asks, with the key, the pace and the
quota that `[service]` of the source declares (kb.core.sources.DeclaredService).
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from urllib.parse import quote

import requests

from kb.core import clock
from kb.core.cached_property import cached_property
from kb.core.context import Run
from kb.core.errors import Challenged, CredentialRefused, ItemFinal, Retryable
from kb.core.sources import SourceDeclaration
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPhase, plan, to_read
from kb.crawl.connector import Answer, Connector, Opened, Phase, seed_requests
from kb.crawl.quota import Quota
from kb.crawl.share import Part, share
from kb.net.rate import Pace
from kb.net.retry import TRIES, Note
from kb.net.session import HttpSession, PerThread, host_of, place, send
from kb.schema.coerce import inner
from kb.store.layout import Layout
from kb.store.rawlog.rawlog import SEEDS, Envelope
from kb.store.state.frontier import Frontier, Item
from kb.store.tables import reading

REFRESHED = "refreshed"  # the cursor with the time of the newest refresh
PART, ELSEWHERE = "part", "other_part"  # the cursor with the last run's share; of another's


@dataclass(frozen=True, kw_only=True)
class ListPhase(Phase):
    """Items that a list of the service answers.

    Where `path` has {keys}, an item is a key, and one list answers up to `batch` of them; without,
    an item is a page of one list, and the first one is where a crawl begins.

    table      the table whose keys its items are
    path       below the service's address: "/questions", "/questions/{keys}/answers"
    split      what stands between keys; a key that has it is asked for alone
    entries    where the entries stand in an answer
    key        where an entry has the key that it was asked for by: one without an entry is gone
    adds       kinds that the entries add items to, and where an entry has their key
    following  what says that the list goes on: true, the next page's number, or a cursor
    page       the parameter that asks for a page or takes the cursor
    first      the first page; "" where a list begins without the parameter, as with cursors
    params     further parameters
    """

    path: str
    table: str = ""
    split: str = ";"
    entries: str = "items"
    key: str = ""
    adds: Mapping[str, str] = field(default_factory=dict)
    following: str = "has_more"
    page: str = "page"
    first: str = "1"
    params: Mapping[str, str] = field(default_factory=dict)

    @property
    def keyed(self) -> bool:
        """Whether its items are keys, not pages."""
        return "{keys}" in self.path

    def listed(self, response: Any) -> list[Any]:
        """The entries of an answer."""
        entries = inner(response, *self.entries.split("."))
        return entries if isinstance(entries, list) else []

    def params_of(self, page: str) -> dict[str, str]:
        """The parameters that ask for a page; "" asks for the first one without naming it."""
        return {**self.params, **({self.page: page} if page else {})}

    def next_page(self, page: str, response: Any) -> str:
        """What asks for the page after this one; "" after the last."""
        following = inner(response, *self.following.split("."))
        if following is True:
            return str(int(page or 1) + 1)
        return str(following) if following else ""


def is_due(frontier: Frontier, days: int) -> bool:
    """Whether the newest refresh, or else the first request, is older than so many days."""
    first = min((day for day, *_ in frontier.ledger()), default="")
    noted = frontier.cursor(REFRESHED, first)
    return bool(noted) and (clock.now() - clock.parse(noted)).total_seconds() >= days * 86_400


def named(entries: Sequence[Any], at: str, prefix: str = "") -> list[str]:
    """The keys that entries have at a path, each once."""
    keys = (inner(entry, *at.split(".")) for entry in entries)
    return list(dict.fromkeys(f"{prefix}{key}" for key in keys if isinstance(key, (str, int))))


def _asked_together(keys: Sequence[str], phase: ListPhase) -> Iterator[list[str]]:
    """The keys of each request: all at once, but for those that `split` would take apart."""
    if whole := [key for key in keys if phase.split not in key]:
        yield whole
    yield from ([key] for key in keys if phase.split in key)


def _noted(keys: Sequence[str], phase: ListPhase) -> str | list[str]:
    """What an answer keeps of the keys that it was asked for; `_keys_of` reads it."""
    joined = phase.split.join(keys)
    return joined if list(keys) == _keys_of(joined, phase) else list(keys)


def _keys_of(noted: str | list[str], phase: ListPhase) -> list[str]:
    """The keys that an answer was asked for."""
    if isinstance(noted, list):
        return noted
    return noted.split(phase.split) if phase.batch > 1 else [noted]


class JsonLists(Connector):
    """What crawls such a service. Keys of a list are those of the kind that the source counts."""

    def __init__(self, run: Run, source: SourceDeclaration, phases: Sequence[ListPhase]) -> None:
        assert source.service is not None
        self.name, self.phases, self._run, self._source = source.name, phases, run, source
        self._of_kind = {phase.kind: phase for phase in phases}
        counted = (kind for kind, noun in source.nouns.items() if noun == source.counted)
        self._counted = next(counted)
        self._again: int | None = None  # the age in days after which a refresh reads again
        self.restrict(None, None)

    @cached_property
    def service(self) -> JsonService:
        """The service, once the data root is open."""
        return JsonService(self._run, self._source, self.opened)

    def identity(self) -> dict[str, str]:
        """The address of the service. Raises MissingCredential."""
        assert self._source.service is not None
        if self._source.service.key:
            self._run.settings.require(self._source.service.key)
        section = self._run.profile.section(self._source.name)
        return {self._source.service.url: str(getattr(section, self._source.service.url))}

    def restrict(self, keys: Sequence[str] | None, part: Part) -> None:
        """Crawl these keys instead of all pages, and this machine's share of the keys."""
        self._known, self._part, self._mine = keys, list(part or ()), share(part)

    def refresh(self, days: int) -> None:
        """Read again what the source declares as refreshed, when it is older than so many days,
        instead of a crawl.
        """
        self._again = days

    def begin(self, opened: Opened) -> None:
        """The data root is open."""
        self.opened = opened

    def seeds(self, frontier: Frontier) -> Iterator[dict[str, Any]]:
        """The keys of --ids that are this part's share."""
        known = (key for key in self._known or () if key not in self.opened.purged)
        mine = (key for key in known if self._mine(key))
        yield from seed_requests(frontier, self._counted, "ids", mine)

    def discover(self, frontier: Frontier) -> None:
        """The first pages, again in a new round; and what was left to other machines. Of a refresh,
        what is due.
        """
        if self._again is not None:
            if is_due(frontier, self._again) and not frontier.open(self._source.refreshed):
                frontier.reopen(self._source.refreshed, "done")
                frontier.set_cursor(REFRESHED, clock.stamp())
            return
        if frontier.cursor(PART, []) != self._part:
            frontier.set_cursor(PART, self._part)
            for phase in self.phases:
                left = [
                    key
                    for key, _, why, _ in frontier.items(phase.kind, "skipped")
                    if why == ELSEWHERE
                ]
                frontier.mark(phase.kind, left, "todo")
        for phase in self._of_kind.values():
            if not phase.keyed and self._known is None:
                if self._run.again:
                    frontier.replace(phase.kind, [phase.first])
                frontier.add_keys(phase.kind, [phase.first])

    def leave_out(self, phase: Phase, item: Item) -> str | None:
        """Keys that were purged or are another part's."""
        if not self._of_kind[phase.kind].keyed:
            return None
        if item.key in self.opened.purged:
            return "purged"
        return None if self._mine(item.key) else ELSEWHERE

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """One page, or all pages of the list of some keys."""
        asked = self._of_kind[phase.kind]
        get = partial(self.service.get, endpoint=asked.path, service=phase.service)
        if not asked.keyed:
            (item,) = items
            params = asked.params_of(item.key)
            yield Answer(phase.kind, asked.path, params, get(asked.path, params))
            return
        prefix = self._prefix(phase.kind)
        for keys in _asked_together([item.key.removeprefix(prefix) for item in items], asked):
            path = asked.path.format(keys=asked.split.join(quote(key, safe="") for key in keys))
            noted, page, complete = _noted(keys, asked), "", False
            while not complete:
                params = asked.params_of(page)
                try:
                    response = get(path, params)
                except ItemFinal as fact:
                    if len(items) == 1:
                        raise
                    raise Retryable(str(fact)) from None  # of which of them, each by itself says
                page = asked.next_page(page or asked.first, response)
                complete = not page
                recorded = {**params, "keys": noted}
                yield Answer(phase.kind, asked.path, recorded, response, complete=complete)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """What an answer lists, and which items it has answered."""
        params, response = envelope.request.params, envelope.response
        if kind == SEEDS:
            frontier.add_keys(self._counted, params["ids"])
            return
        phase = self._of_kind[kind]
        entries = phase.listed(response)
        page = params.get(phase.page, phase.first)
        following = phase.next_page(page, response)
        with frontier.transaction():
            for other, at in phase.adds.items():
                frontier.add_keys(other, named(entries, at, self._prefix(other)))
            if not phase.keyed:
                frontier.add_keys(kind, [page, *([following] if following else [])])
                frontier.done(kind, page)
                return
            prefix = self._prefix(kind)
            keys = [f"{prefix}{key}" for key in _keys_of(params["keys"], phase)]
            if page == phase.first:
                frontier.add_keys(kind, keys)
                frontier.mark(kind, keys, "in_progress")
            if not phase.key:
                answered = [] if following else keys
            else:
                answered = [key for key in named(entries, phase.key, prefix) if key in keys]
            frontier.done(kind, *answered)
            if phase.key and not following:
                states = ((key, frontier.get(kind, key)) for key in keys)
                absent = [key for key, state in states if state and state[0] == "in_progress"]
                frontier.mark(kind, absent, "skipped", "not_found")

    def _prefix(self, kind: str) -> str:
        """What the keys of a kind begin with in the frontier, as the source declares."""
        return self._source.tables.get(self._of_kind[kind].table, "")

    def close(self) -> None:
        """Close the connections."""
        if "service" in self.__dict__:
            self.service.close()

    def plan(self, command: str, kinds: Sequence[str] = ()) -> Summary:
        """What is left of `kinds`, by default of all, as far as it is known: sends nothing."""
        assert self._source.service is not None
        left: dict[str, int] = {}
        counts: Mapping[str, Mapping[str, int]] = {}
        path = Layout(self._run.root).state(self.name)
        if path.is_file():
            with reading.state(path) as frontier:
                counts = frontier.kinds()
                left = {kind: to_read(counts, kind) for kind in counts}
                if self._again is not None and is_due(frontier, self._again):
                    refreshed = self._source.refreshed
                    left[refreshed] = sum(counts.get(refreshed, {}).values())
                fresh = [k for k in self._known or () if frontier.get(self._counted, k) is None]
                left[self._counted] = left.get(self._counted, 0) + len(fresh)
        elif self._known is not None:
            left[self._counted] = len(self._known)
        lines, units = [], self._source.service.units
        for phase in self._of_kind.values():
            items = left.get(phase.kind, 0)
            if not phase.keyed and self._known is None and (not left or self._run.again):
                items = max(sum(counts.get(phase.kind, {}).values()), 1)
            if phase.kind in (kinds or self._of_kind) and items:
                asked = math.ceil(items / phase.batch)
                hours = asked * self._source.service.seconds_between / 3600
                spent = asked * units.get(phase.path, 1)
                lines.append(PlanPhase(phase.unit, items, asked, spent, hours))
        per_day = quota_of(self._run, self._source).per_day
        days = math.ceil(sum(line.units for line in lines) / per_day) if per_day else None
        assumed = ["one page a list, and nothing that is not listed yet"]
        more = {} if days is None else {"days": days}
        return Summary(plan(command, self.name, lines, assumed, **more))


class JsonService:
    """The service of a source, at the address that its section names. Thread-safe.

    The ledger's bucket is the name of the source. What its statuses mean:

    200        the answer
    404, 410   a fact about what was asked for: ItemFinal("not_found")
    401, 403   the key is refused; without a key, whoever asks is
    429        waited for; where that does not end, Blocked
    others     Retryable
    """

    def __init__(self, run: Run, source: SourceDeclaration, opened: Opened) -> None:
        assert source.service is not None
        self._source, self._declared, self._opened = source, source.service, opened
        self._settings = run.settings
        section = run.profile.section(source.name)
        self._root = str(getattr(section, self._declared.url)).rstrip("/")
        self._quota = quota_of(run, source)
        self._tries = getattr(section, "max_tries", TRIES)
        self._pace = Pace(self._declared.seconds_between)
        self._sessions = PerThread(self._session)
        self._asked = threading.local()  # what the ledger calls this thread's request

    def get(
        self, path: str, params: Mapping[str, Any], *, endpoint: str = "", service: str = "main"
    ) -> Any:
        """The answer of a GET, after several tries. `endpoint` is what the ledger calls it, its
        path by default. Raises as above, QuotaSpent before a request that is one too many.
        """
        once = partial(self._once, path, params, endpoint or path)
        return self._opened.attempt(service, once, self._tries)

    def close(self) -> None:
        """Close the connections."""
        self._sessions.close()

    def _session(self) -> HttpSession:
        session = HttpSession(self._settings, hosts={host_of(self._root)}, ledger=self._row)
        if (key := self._key) and self._declared.sent.startswith("header:"):
            name, _, form = self._declared.sent.removeprefix("header:").partition(":")
            session.headers[name.strip()] = (form.strip() or "{}").format(key)
        return session

    @property
    def _key(self) -> str:
        return self._settings.need(self._declared.key) if self._declared.key else ""

    def _once(self, path: str, params: Mapping[str, Any], endpoint: str) -> Any:
        sent = dict(params)
        if self._key and self._declared.sent.startswith("query:"):
            sent[self._declared.sent.removeprefix("query:").strip()] = self._key
        self._pace.wait()
        self._asked.endpoint = endpoint
        response = send(self._sessions.session, "GET", self._root + path, params=sent)
        return self._meaning(response)

    def _meaning(self, response: requests.Response) -> Any:
        status, where = response.status_code, place(response.url)
        if status in (404, 410):
            raise ItemFinal("not_found", str(status))
        if status in (401, 403) and self._declared.key:
            raise CredentialRefused(
                f"the service refuses the key ({status} at {where})",
                hint=f"check {self._declared.key.upper()}",
            )
        if status in (401, 403):
            raise Challenged(
                f"the service turns requests away ({status} at {where})",
                hint="run the same command from a network that it accepts",
            )
        if status != 200:
            raise Retryable(f"HTTP {status} at {where}", status=status)
        try:
            return response.json()
        except (ValueError, RecursionError):
            raise Retryable(f"an answer that is not JSON at {where}") from None

    def _row(self, request: requests.PreparedRequest) -> Note:
        """The ledger's row of a request that is about to be sent. Raises QuotaSpent."""
        endpoint = self._asked.endpoint
        return self._opened.spend(self._quota, endpoint, self._declared.units.get(endpoint, 1))


def quota_of(run: Run, source: SourceDeclaration) -> Quota:
    """What the service of a source gives a day."""
    assert source.service is not None
    per_day = source.service.per_day
    if isinstance(per_day, str):
        per_day = int(getattr(run.profile.section(source.name), per_day))
    called = f"{source.title}'s quota of {per_day:,} units a day"
    return Quota(source.name, called, per_day, source.service.time_zone)
