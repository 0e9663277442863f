"""Plain HTTP, one way for every service: who we are, how long we wait, what an answer means."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kb import __version__
from kb.core.errors import Retryable
from kb.net import redact
from kb.net.retry import retry_after

if TYPE_CHECKING:
    import requests

    from kb.core.settings import Settings

PRODUCT = "lorebase"  # our name in the User-Agent and in robots.txt
TIMEOUT_S = (10.0, 60.0)  # to connect, and between two bytes


def user_agent(contact: str | None) -> str:
    """Name, version and whom to write to."""
    return f"{PRODUCT}/{__version__}" + (f" (+{contact})" if contact else "")


def make_session(settings: Settings) -> requests.Session:
    """A session with our User-Agent and timeouts. Not for several threads at once.

    It retries nothing by itself: that is kb.net.retry's. Credentials are those of the settings alone,
    never of ~/.netrc; proxies of the environment are used. Raises SettingError for a contact
    that is none.
    """
    import requests

    settings.check_contact()

    class Session(requests.Session):
        def request(self, *arguments: Any, **options: Any) -> requests.Response:
            if options.get("timeout") is None:
                options["timeout"] = TIMEOUT_S
            return super().request(*arguments, **options)

        def rebuild_auth(self, prepared_request: Any, response: Any) -> None:
            if "Authorization" in prepared_request.headers and self.should_strip_auth(
                response.request.url, prepared_request.url
            ):
                del prepared_request.headers["Authorization"]

    session = Session()
    # With an `auth` of our own requests looks for none in ~/.netrc, which would take the place of our token.
    session.auth = lambda request: request
    session.headers["User-Agent"] = user_agent(settings.kb_contact)
    return session


def send(session: requests.Session, method: str, url: str, **options: Any) -> requests.Response:
    """One request, its answer whole. Raises Retryable for what may go well next time.

    Broken connections and time-outs (`unreachable`), 429 and 5xx (`after` as the service wishes). Any other
    status is the caller's to judge. Messages hold no secret, as they may end in a log or a table.
    """
    import requests

    try:
        response = session.request(method, url, **options)
        response.content  # noqa: B018  an answer that breaks off raises here
    except (
        requests.ConnectionError,
        requests.Timeout,
        requests.exceptions.ChunkedEncodingError,
        requests.exceptions.ContentDecodingError,
    ) as error:
        raise Retryable(
            redact.text(f"{type(error).__name__} at {_place(url)}"), unreachable=True
        ) from None
    if response.status_code == 429 or response.status_code >= 500:
        raise Retryable(
            f"HTTP {response.status_code} at {_place(url)}",
            after=retry_after(response.headers.get("Retry-After")),
            throttled=response.status_code == 429,
        )
    return response


def _place(url: str) -> str:
    """Host and path of a URL, without its query."""
    return redact.text(url.partition("?")[0])
