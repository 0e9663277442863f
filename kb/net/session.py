"""The one way out: every request of ours and of the libraries we use goes through `HttpSession`.

A request goes, in this order: is its host one that was asked for, and may it be asked in the clear
→ the ledger's row → out → the row's outcome. Redirects are requests of their own. Answers are
bounded in bytes and time (kb.net.bounded). What is asked of this machine goes through no proxy.
Nothing is tried again here: that is kb.net.retry's, for what `failure` and `refusal` call
Retryable.
"""

import threading
from collections.abc import Callable, Collection
from typing import Any
from urllib.parse import urlsplit

import requests
import urllib3
from requests.adapters import HTTPAdapter

from kb.core.config.addresses import in_the_clear
from kb.core.config.settings import Settings
from kb.core.errors import FatalError, ItemFinal, KbError, Retryable, SettingError
from kb.net import bounded, redact
from kb.net.certificates import authorities, untrusted
from kb.net.proxies import proxy_of
from kb.net.retry import Note, retry_after
from kb.version import __version__

PRODUCT = "lorecrawl"  # our name in the User-Agent and in robots.txt
TIMEOUT_S = (10.0, 60.0)  # to connect, and between two bytes
_BROKEN = (
    requests.ConnectionError,
    requests.Timeout,
    requests.exceptions.ChunkedEncodingError,
)
_NO_ADDRESS = (
    requests.exceptions.InvalidURL,
    requests.exceptions.InvalidSchema,
    requests.exceptions.MissingSchema,
    requests.TooManyRedirects,
)

Ledger = Callable[[requests.PreparedRequest], Note | None]
"""Writes the row of a request before it goes out; what it returns notes the outcome. May raise."""
Stray = Callable[[str], Exception]
"""The error for a request that would leave the service's hosts: (address)."""


def user_agent(contact: str | None) -> str:
    """Name, version and whom to write to."""
    return f"{PRODUCT}/{__version__}" + (f" (+{contact})" if contact else "")


def host_of(url: str) -> str:
    """Scheme, host and port of an address, as `HttpSession` compares them."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc}".lower()


class HttpSession(requests.Session):
    """One connection pool with the policy of this module. Not for several threads at once.

    `hosts` are the only ones that are asked, as `host_of` gives them; None allows any. Of the
    environment only proxies and certificates count (kb.net.proxies, kb.net.certificates), never
    ~/.netrc: credentials are those of the settings alone. Raises SettingError for a malformed
    contact or file of certificates.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        hosts: Collection[str] | None = None,
        ledger: Ledger | None = None,
        stray: Stray | None = None,
        timeout: tuple[float, float] = TIMEOUT_S,
    ) -> None:
        settings.check_contact()
        super().__init__()
        self._timeout = timeout
        self.trust_env = False
        self.verify = authorities()[1] or True
        self.headers["User-Agent"] = user_agent(settings.kb_contact)
        self.adapters.clear()  # nothing goes past ours
        self.mount("", Door(hosts=hosts, ledger=ledger, stray=stray))

    def request(self, *arguments: Any, **options: Any) -> requests.Response:
        """As in requests, with our time-outs where none are given."""
        if options.get("timeout") is None:
            options["timeout"] = self._timeout
        return super().request(*arguments, **options)


class Door(HTTPAdapter):
    """What every single request passes, redirects included."""

    def __init__(
        self,
        *,
        hosts: Collection[str] | None = None,
        ledger: Ledger | None = None,
        stray: Stray | None = None,
    ) -> None:
        super().__init__()
        self._hosts = None if hosts is None else frozenset(hosts)
        self._ledger, self._stray = ledger, stray or _stray

    def init_poolmanager(self, *arguments: Any, **options: Any) -> None:
        """Pools of connections that are watched."""
        super().init_poolmanager(*arguments, **options)
        bounded.watched(self.poolmanager)

    def proxy_manager_for(self, proxy: str, **options: Any) -> Any:
        """The same through a proxy."""
        return bounded.watched(super().proxy_manager_for(proxy, **options))

    def send(self, request: requests.PreparedRequest, *arguments: Any, **options: Any) -> Any:
        """One request on the wire.

        Raises what `stray` makes, what the ledger raises, and Untrusted.
        """
        self.require_allowed(request.url or "")
        note = self._ledger(request) if self._ledger is not None else None
        try:
            response = self.pass_on(request, *arguments, **options)
            if response.is_redirect or not options.get("stream"):
                bounded.read_body(response)
        except BaseException as error:
            if note is not None:
                note(type(error).__name__, sent=not never_sent(error))
            if problem := untrusted(error, request.url or ""):
                raise problem from None
            raise
        if note is not None:
            note(str(response.status_code))
        return response

    def require_allowed(self, url: str) -> None:
        """Raises when nothing may be sent to an address."""
        if self._hosts is not None and host_of(url) not in self._hosts:
            raise self._stray(url)
        if in_the_clear(url):
            raise self._stray(url)  # what we send and read is nobody else's on the way

    def pass_on(self, request: requests.PreparedRequest, *arguments: Any, **options: Any) -> Any:
        """Send it as it is, through the proxy of its own address."""
        proxy = proxy_of(request.url or "")
        options["proxies"] = {"all": proxy} if proxy else {}
        return super().send(request, *arguments, **options)


class PerThread:
    """A session for each thread that asks, made by `make` when it is first needed."""

    def __init__(self, make: Callable[[], HttpSession]) -> None:
        self._make, self._held, self._all = make, threading.local(), list[HttpSession]()
        self._lock = threading.Lock()

    @property
    def session(self) -> HttpSession:
        """This thread's session."""
        if not hasattr(self._held, "session"):
            self._held.session = self._make()
            with self._lock:
                self._all.append(self._held.session)
        return self._held.session

    def close(self) -> None:
        """Close the connections of all threads."""
        with self._lock:
            for session in self._all:
                session.close()
            self._all.clear()


def send(session: requests.Session, method: str, url: str, **options: Any) -> requests.Response:
    """One request, its answer complete unless `stream` is given (then read it by `bounded.parts`).

    Raises what `failure` and `refusal` make of it. Any other status is the
    caller's to judge. Messages hold no secret, as they may end in a log or a table.
    """
    try:
        response = session.request(method, url, **options)
    except requests.RequestException as error:
        raise failure(error, url) from None
    refused = refusal(response, url)
    if refused is not None:
        response.close()
        raise refused
    return response


def failure(error: Exception, url: str) -> KbError:
    """What follows from a request that got no whole answer:
    Retryable, or ItemFinal("bad_address").
    """
    if isinstance(error, _NO_ADDRESS):
        return ItemFinal("bad_address", type(error).__name__)
    what = f"{type(error).__name__} at {place(url)}"
    return Retryable(what, unreachable=isinstance(error, _BROKEN))


def never_sent(error: BaseException) -> bool:
    """Whether no connection was made (refused, no address, a proxy, a handshake, a time-out, a
    wrong setting), so that the service knows nothing of the request.
    """
    cause = error.args[0] if error.args else None
    return isinstance(error, SettingError) or isinstance(
        getattr(cause, "reason", cause),
        (
            urllib3.exceptions.ConnectTimeoutError,
            urllib3.exceptions.NewConnectionError,
            urllib3.exceptions.ProxyError,
            urllib3.exceptions.SSLError,
        ),
    )


def refusal(response: requests.Response, url: str) -> Retryable | None:
    """What follows from an answer that says "not now" (408, 429, 5xx); None for any other."""
    status = response.status_code
    if status not in (408, 429) and status < 500:
        return None
    after = retry_after(response.headers.get("Retry-After"), response.headers.get("Date"))
    return Retryable(
        f"HTTP {status} at {place(url)}", after=after, throttled=status == 429, status=status
    )


def place(url: str) -> str:
    """Host and path of an address, without its query."""
    return redact.text(url.partition("?")[0])


def _stray(url: str) -> FatalError:
    why = ", which is not https" if in_the_clear(url) else ""
    return FatalError(f"a service redirects to {place(url)}{why}", hint="nothing was sent there")
