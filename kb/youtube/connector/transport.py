"""The Data API's requests through our session, as Google's client wants to send them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import httplib2
import requests

from kb.net.session import HttpSession


class Transport:
    """Stands in for httplib2.Http. Raises requests' exceptions."""

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
        """One request: (headers and status, body). A redirect of an API is no answer."""
        answer = self._session.request(
            method, uri, data=body, headers=dict(headers or {}), allow_redirects=False
        )
        return _response(answer), answer.content

    def close(self) -> None:
        """Close the connections."""
        self._session.close()


def _response(answer: requests.Response) -> httplib2.Response:
    fields = {name.lower(): value for name, value in answer.headers.items()}
    response = httplib2.Response({**fields, "status": str(answer.status_code)})
    response.reason = answer.reason
    return response
