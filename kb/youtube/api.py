"""The Data API through Google's client: one call, its unit in the ledger first, its errors sorted."""

from __future__ import annotations

import http.client
import json
from typing import Any

from kb.core.errors import Retryable
from kb.core.profile.youtube import YouTube
from kb.core.settings import Settings
from kb.net.client import TIMEOUT_S, user_agent
from kb.net.retry import attempt, retry_after
from kb.store.frontier import Frontier
from kb.youtube import quota
from kb.youtube.errors import meaning

GOOGLE = "https://youtube.googleapis.com"


class Api:
    """The calls that a crawl makes. Not for several threads at once (httplib2 is not thread-safe)."""

    def __init__(self, settings: Settings, profile: YouTube, frontier: Frontier) -> None:
        import httplib2
        from googleapiclient.discovery import build

        # build() must not see a secret in an exception of its own; it only reads a file of the package.
        self._http = httplib2.Http(timeout=TIMEOUT_S[1])
        self._service = build(
            "youtube",
            "v3",
            developerKey=settings.need("youtube_api_key"),
            http=self._http,
            static_discovery=True,
            cache_discovery=False,
            client_options={"api_endpoint": settings.kb_youtube_endpoint or GOOGLE},
        )
        self._agent = user_agent(settings.kb_contact)
        self._profile, self._frontier = profile, frontier

    def search(self, **params: Any) -> dict[str, Any]:
        """search.list: the one call of the search bucket."""
        return self._call(quota.SEARCH, "search.list", self._service.search().list(**params))

    def playlist_items(self, **params: Any) -> dict[str, Any]:
        """playlistItems.list. Raises ItemFinal("not_found") for a list that does not exist."""
        return self._call(quota.GENERAL, "playlistItems.list", self._service.playlistItems().list(**params))

    def videos(self, **params: Any) -> dict[str, Any]:
        """videos.list, up to 50 ids; ids that are gone are absent from the answer."""
        return self._call(quota.GENERAL, "videos.list", self._service.videos().list(**params))

    def close(self) -> None:
        """Close the connections."""
        self._service.close()

    def _call(self, bucket: str, endpoint: str, request: Any) -> dict[str, Any]:
        request.headers["user-agent"] = self._agent
        return attempt(lambda: self._once(bucket, endpoint, request), tries=self._profile.max_tries)

    def _once(self, bucket: str, endpoint: str, request: Any) -> dict[str, Any]:
        import httplib2
        from googleapiclient.errors import HttpError

        row = quota.spend(self._frontier, self._profile, bucket, endpoint)
        try:
            # num_retries=0: the client would also retry the 429 of a bucket that is spent for the day.
            answer = request.execute(num_retries=0)
        except HttpError as error:
            # Never the client's own text: it holds the URL, and so the key.
            self._frontier.outcome(row, str(error.resp.status))
            raise meaning(int(error.resp.status), _json(error.content), bucket, retry_after(error.resp.get("retry-after"))) from None
        except (httplib2.HttpLib2Error, http.client.HTTPException, OSError, ValueError) as error:
            self._frontier.outcome(row, type(error).__name__)
            raise Retryable(f"{type(error).__name__} at {endpoint}", unreachable=not isinstance(error, ValueError)) from None
        if not isinstance(answer, dict):
            # A body that was cut off comes back as text, without an error.
            self._frontier.outcome(row, "truncated")
            raise Retryable(f"a truncated answer of {endpoint}")
        self._frontier.outcome(row, "200")
        return answer


def _json(content: Any) -> Any:
    try:
        return json.loads(content)
    except (TypeError, ValueError):
        return None
