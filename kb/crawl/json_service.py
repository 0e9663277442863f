"""A service that answers in JSON: its key, its pace and its quota, as `[service]` of a source
declares them (kb.core.sources.DeclaredService), and what its statuses mean.

200        the answer
404, 410   a fact about what was asked for: ItemFinal("not_found")
401, 403   the key is refused; without a key, whoever asks is
429        waited for; where that does not end, Blocked
others     Retryable
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import partial
from typing import Any

import requests

from kb.core.context import Run
from kb.core.errors import Challenged, CredentialRefused, ItemFinal, Retryable
from kb.core.sources import SourceDeclaration
from kb.crawl.connector import Opened
from kb.crawl.quota import Quota
from kb.net.rate import Pace
from kb.net.retry import TRIES
from kb.net.session import HttpSession, Note, PerThread, host_of, place, send


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
