"""Reads the responses to a page's requests from Chromium's performance log, by URL.

Scripts of the page see neither Retry-After nor why an image failed; the log has both.
"""

import json
from dataclasses import dataclass
from typing import Any

from kb.core.errors import Retryable
from kb.net import retry
from kb.wiki.browser.browser import Browser


@dataclass(frozen=True)
class DocumentResponse:
    """The last response of a URL: `status` is 0 when there was none, or when it was cut off.

    `after` is its Retry-After in seconds. `barred`: the browser itself blocked the request.
    """

    status: int
    after: float | None = None
    barred: bool = False

    @property
    def may_come_back(self) -> bool:
        """Whether a retry can help: not for absent or refused URLs."""
        return not self.barred and (self.status in (0, 429) or self.status >= 500)


class PageTraffic:
    """The responses since the page was opened; `read` updates them."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._addresses: dict[str, str] = {}
        self._failed: set[str] = set()
        self._frame: str | None = None  # of the page itself
        self._document: str | None = None  # the newest request for it
        self.served: dict[str, DocumentResponse] = {}
        browser.record()  # forget the pages before

    def read(self) -> None:
        """Process the log entries since the last call. Raises Retryable."""
        for entry in self._browser.record():
            event = json.loads(entry["message"])["message"]
            self._note(event["method"], event["params"])

    def _note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self._addresses[params["requestId"]] = _bare(params["request"]["url"])
            if params.get("type") == "Document":
                self._frame = self._frame or params.get("frameId")
                if params.get("frameId") == self._frame:
                    self._document = params["requestId"]
        elif method == "Network.responseReceived":
            answer = params["response"]
            headers = {name.lower(): value for name, value in answer.get("headers", {}).items()}
            self.served[_bare(answer["url"])] = DocumentResponse(
                int(answer["status"]),
                retry.retry_after(headers.get("retry-after"), headers.get("date")),
            )
        elif method == "Network.loadingFailed":
            self._failed.add(params["requestId"])
            url = self._addresses.get(params["requestId"])
            # An error page's body is not wanted by an image: the status before it says more.
            if url is not None and (url not in self.served or self.served[url].status < 400):
                self.served[url] = DocumentResponse(0, barred="blockedReason" in params)

    @property
    def cut_off(self) -> bool:
        """Whether the page's own document was cut off: Chromium shows what had arrived."""
        return self._document in self._failed

    def document(self) -> str | None:
        """The text of the page's own document; None when the browser no longer has it."""
        try:
            answer = self._browser.devtools(
                "Network.getResponseBody", {"requestId": self._document}
            )
        except Retryable:
            return None
        return None if answer["base64Encoded"] else str(answer["body"])

    def of(self, url: str) -> DocumentResponse | None:
        """The last response of a URL; None when it was not requested."""
        return self.served.get(_bare(url))


def _bare(url: str) -> str:
    return url.split("#", 1)[0]
