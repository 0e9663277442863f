"""The Data API through Google's client: calls, their quota units, and what its errors mean; and the
one question of `kb profile check --online`.

Errors: https://developers.google.com/youtube/v3/docs/errors, decided by codes and reasons, never by
wording.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from typing import Any

import requests

from kb.core import terminal
from kb.core.config.section import ERROR, NOTE, WRONG, OnlineAnswer, QuestionCost
from kb.core.context import Run
from kb.core.errors import Challenged, CredentialRefused, ItemFinal, KbError, Retryable
from kb.core.installation import googleapiclient, httplib2
from kb.crawl.connector import Opened, asking
from kb.crawl.quota import Quota
from kb.net.retry import Note, blocked, retry_after
from kb.net.session import HttpSession, failure, host_of, user_agent
from kb.youtube.crawl.quota import API, GENERAL, SEARCH, STATISTICS, quota
from kb.youtube.section import YouTubeSection

GOOGLE = "https://youtube.googleapis.com"
_SPENT = {"quotaExceeded", "dailyLimitExceeded", "dailyLimitExceededUnreg"}
_BURST = {"rateLimitExceeded", "userRateLimitExceeded"}
_KEY = {
    "keyInvalid",
    "keyExpired",
    "accessNotConfigured",
    "ipRefererBlocked",
    "forbidden",
    "authError",
    "required",
    "API_KEY_INVALID",
    "API_KEY_SERVICE_BLOCKED",
    "SERVICE_DISABLED",
}
# Facts about a list or its channel: it can't be read, today or tomorrow. Any other refusal may be
# the service's or our own fault.
FINAL = {
    "not_found",
    "playlistNotFound",
    "playlistItemsNotAccessible",
    "playlistOperationUnsupported",
    "channelNotFound",
    "channelForbidden",
    "channelClosed",
    "channelSuspended",
}


class YouTubeApi:
    """The calls that a crawl makes. Not for several threads at once.

    With `--wait` it sleeps however long the service asks for.
    """

    def __init__(self, profile: YouTubeSection, opened: Opened) -> None:
        settings = opened.run.settings
        endpoint = settings.kb_youtube_endpoint or GOOGLE
        session = HttpSession(settings, hosts={host_of(endpoint)}, ledger=self._row)
        # build() only reads a file of the package, so that no error of its own shows the key.
        self._client = googleapiclient.discovery.build(
            "youtube",
            "v3",
            developerKey=settings.need("youtube_api_key"),
            http=Transport(session),
            static_discovery=True,
            cache_discovery=False,
            client_options={"api_endpoint": endpoint},
        )
        self._agent = user_agent(settings.kb_contact)  # Google's client would put its own there
        self._profile, self._opened = profile, opened
        self._asked = quota(profile, GENERAL), ""  # what the ledger calls the request

    def search(self, **params: Any) -> dict[str, Any]:
        """search.list: the one call of the search bucket."""
        return self._call(SEARCH, "search.list", self._client.search().list(**params))

    def playlist_items(self, **params: Any) -> dict[str, Any]:
        """playlistItems.list. Raises ItemFinal("not_found") for a list that does not exist."""
        return self._call(
            GENERAL, "playlistItems.list", self._client.playlistItems().list(**params)
        )

    def playlists(self, **params: Any) -> dict[str, Any]:
        """playlists.list, up to 50 ids; those that are gone or private are absent."""
        return self._call(GENERAL, "playlists.list", self._client.playlists().list(**params))

    def videos(self, **params: Any) -> dict[str, Any]:
        """videos.list, up to 50 ids; ids that are gone are absent from the answer."""
        return self._call(GENERAL, "videos.list", self._client.videos().list(**params))

    def statistics(self, **params: Any) -> dict[str, Any]:
        """videos.batchGetStats, up to 50 ids; an id that is left out may exist all the same."""
        return self._call(
            STATISTICS, "videos.batchGetStats", self._client.videos().batchGetStats(**params)
        )

    def close(self) -> None:
        self._client.close()

    def _call(self, bucket: str, endpoint: str, request: Any) -> dict[str, Any]:
        """The answer, after several tries."""
        request.headers["user-agent"] = self._agent
        self._asked = quota(self._profile, bucket), endpoint
        return self._opened.attempt(API, partial(self._once, request), self._profile.max_tries)

    def _once(self, request: Any) -> dict[str, Any]:
        asked, endpoint = self._asked
        try:
            # num_retries=0: the client would retry the 429 of a bucket that is spent for the day.
            answer = request.execute(num_retries=0)
        except googleapiclient.errors.HttpError as error:
            # Never the client's own text: it holds the URL, and so the key.
            after = retry_after(error.resp.get("retry-after"), error.resp.get("date"))
            raise meaning(int(error.resp.status), _json(error.content), asked, after) from None
        except (requests.RequestException, OSError, ValueError, RecursionError) as error:
            broken = failure(error, endpoint)
            unreachable = isinstance(broken, Retryable) and broken.unreachable
            raise Retryable(
                f"{type(error).__name__} at {endpoint}", unreachable=unreachable
            ) from None
        if not isinstance(answer, dict):
            # A body that was cut off comes back as text, without an error.
            raise Retryable(f"a truncated answer of {endpoint}")
        return answer

    def _row(self, request: requests.PreparedRequest) -> Note:
        return self._opened.spend(*self._asked)


def _json(content: Any) -> Any:
    try:
        return json.loads(content)
    except (TypeError, ValueError, RecursionError):
        return None


class Transport:
    """httplib2.Http's interface over our session. Raises requests' exceptions."""

    def __init__(self, session: HttpSession) -> None:
        self._session = session

    def request(
        self,
        uri: str,
        method: str = "GET",
        body: Any = None,
        headers: Mapping[str, str] | None = None,
        redirections: int = 0,
        connection_type: Any = None,
    ) -> tuple[httplib2.Response, bytes]:
        """Send one request; return (headers and status, body). Redirects are not followed."""
        answer = self._session.request(
            method, uri, data=body, headers=dict(headers or {}), allow_redirects=False
        )
        fields = {name.lower(): value for name, value in answer.headers.items()}
        response = httplib2.Response({**fields, "status": str(answer.status_code)})
        response.reason = answer.reason
        return response, answer.content

    def close(self) -> None:
        self._session.close()


def meaning(status: int, body: Any, asked: Quota, after: float | None = None) -> KbError:
    """The error to raise for an error answer: QuotaSpent, CredentialRefused, Blocked,
    Challenged, ItemFinal or Retryable.

    ItemFinal for the named facts only; a refusal without a reason comes not from the API but
    from what stands before it ("automated queries"). `after` is the answer's Retry-After in
    seconds.
    """
    error = body.get("error") if isinstance(body, dict) else None
    error = error if isinstance(error, dict) else {}
    reasons = {
        str(part.get("reason"))
        for part in (*_parts(error, "errors"), *_parts(error, "details"))
        if part.get("reason")
    }
    limits = [
        str(part.get("metadata", {}).get("quota_limit", ""))
        for part in _parts(error, "details")
        if isinstance(part.get("metadata"), dict)
    ]
    shown = min(reasons) if reasons else f"http_{status}"
    if reasons & _SPENT or (status == 429 and any("PerDay" in name for name in limits)):
        return asked.spent()
    if status == 429 or reasons & _BURST:
        return Retryable(f"{shown} ({status})", after=after, throttled=True)
    if status >= 500:
        return Retryable(f"HTTP {status} from the YouTube API", after=after)
    if status == 401 or reasons & _KEY:
        return CredentialRefused(
            f"the YouTube API refuses the key ({shown})",
            hint="check YOUTUBE_API_KEY and that the YouTube Data API v3 is enabled for it",
        )
    if facts := sorted(reasons & FINAL):
        return ItemFinal("not_found" if status == 404 else facts[0], str(status))
    if status == 403 and not reasons:
        what = "the YouTube API rejects requests (403 without a reason)"
        if after:
            return blocked(what, after, waited=True)
        return Challenged(what, hint="run the same command from a network that Google accepts")
    return Retryable(f"{shown} ({status})", after=after)


def _parts(error: dict[str, Any], name: str) -> list[dict[str, Any]]:
    parts = error.get(name)
    return [part for part in parts if isinstance(part, dict)] if isinstance(parts, list) else []


def question(run: Run, cost: QuestionCost) -> OnlineAnswer:
    """One channel search: 1 of the search bucket's units."""
    section = run.profile.section(YouTubeSection)
    words = section.keywords[0]
    with asking(run, cost) as opened:
        api = YouTubeApi(section.model_copy(update={"max_tries": 1}), opened)
        cost.units = 1
        answer = api.search(q=words, type="channel", part="snippet", maxResults=5)
        api.close()
    items = answer.get("items", [])
    titles = [terminal.shown(str(one.get("snippet", {}).get("title", ""))) for one in items]
    searched = f"a search for {terminal.shown(words)}"
    if not titles:
        fix = "search for words that channels of the domain use in their names"
        return OnlineAnswer(ERROR, "youtube.keywords", f"{searched} finds no channel", fix, WRONG)
    shown = ", ".join(titles[:3])
    return OnlineAnswer(NOTE, "youtube.keywords", f"{searched} finds channels such as {shown}")
