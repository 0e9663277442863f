"""A service that answers in JSON: its key, its pace and its quota, as `[service]` of a source
declares them (kb.core.sources.DeclaredService), and what its statuses mean.

200        the answer
404, 410   a fact about what was asked for: ItemFinal("not_found")
401, 403   the key is refused; without a key, whoever asks is
429        waited for; where that does not end, Blocked
others     Retryable
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any
from zoneinfo import ZoneInfo

import requests

from kb.core import clock
from kb.core.context import Run
from kb.core.errors import Challenged, CredentialRefused, ItemFinal, QuotaSpent, Retryable
from kb.core.sources import SourceDeclaration
from kb.crawl.connector import Opened
from kb.net.rate import Pace
from kb.net.retry import PATIENCE_S, TRIES, attempt, blocked
from kb.net.session import HttpSession, PerThread, host_of, place, send


class Day:
    """A service's day, which begins at its own midnight."""

    def __init__(self, time_zone: str) -> None:
        self._zone = ZoneInfo(time_zone)

    def today(self) -> str:
        """The day now, "2026-11-20"."""
        return f"{clock.now().astimezone(self._zone):%Y-%m-%d}"

    def end(self) -> datetime:
        """Its next midnight, as UTC."""
        local = clock.now().astimezone(self._zone)
        midnight = datetime.combine(local.date() + timedelta(days=1), datetime.min.time())
        return midnight.replace(tzinfo=self._zone).astimezone(UTC)


class JsonService:
    """The service of a source, at the address that its section names. Thread-safe.

    The ledger's bucket is the name of the source.
    """

    def __init__(self, run: Run, source: SourceDeclaration, opened: Opened) -> None:
        assert source.service is not None
        self._source, self._declared, self._opened = source, source.service, opened
        self._settings = run.settings
        section = run.profile.section(source.name)
        self._root = str(getattr(section, self._declared.url)).rstrip("/")
        self.per_day = units_per_day(run, source)
        self._tries = getattr(section, "max_tries", TRIES)
        self._patience = math.inf if run.wait else PATIENCE_S
        self._day = Day(self._declared.time_zone)
        self._pace = Pace(self._declared.seconds_between)
        self._sessions = PerThread(self._session)
        self._asked = threading.local()  # what the ledger calls this thread's request

    def get(
        self, path: str, params: Mapping[str, Any], *, endpoint: str = "", service: str = "main"
    ) -> Any:
        """The answer of a GET, after several tries. `endpoint` is what the ledger calls it, its
        path by default. Raises as above, QuotaSpent before a request that is one too many.
        """
        return attempt(
            partial(self._probe, path, params, endpoint or path, service),
            tries=self._tries,
            patience=self._patience,
            sleep=partial(self._opened.sleep, service),
        )

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

    def _probe(self, path: str, params: Mapping[str, Any], endpoint: str, service: str) -> Any:
        """One try; after a block the first one decides whether it still stands."""
        self._opened.check(service)
        try:
            return self._once(path, params, endpoint)
        except Retryable as error:
            if error.throttled and self._opened.probing(service):
                why = f"the service still rejects requests ({error})"
                raise blocked(why, error.after) from None
            raise

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

    def _row(self, request: requests.PreparedRequest) -> Callable[[str], None]:
        """The ledger's row of a request that is about to be sent. Raises QuotaSpent."""
        frontier, bucket, day = self._opened.frontier, self._source.name, self._day.today()
        endpoint = self._asked.endpoint
        units = self._declared.units.get(endpoint, 1)
        if self.per_day and frontier.spent(bucket, day) + units > self.per_day:
            raise self.spent()
        row = frontier.spend(bucket, units, endpoint, day=day)
        return partial(frontier.outcome, row)

    def spent(self) -> QuotaSpent:
        """The error for a quota that is used up for today."""
        reset = self._day.end()
        return QuotaSpent(
            f"{self._source.title}'s quota of {self.per_day:,} units a day is spent; it is reset at"
            f" {clock.stamp(reset)}",
            hint="run the same command then, or add --wait",
            until=reset,
        )


def units_per_day(run: Run, source: SourceDeclaration) -> int:
    """Units of the service's quota; 0 without one."""
    declared = source.service.per_day if source.service else 0
    if isinstance(declared, int):
        return declared
    return int(getattr(run.profile.section(source.name), declared))
