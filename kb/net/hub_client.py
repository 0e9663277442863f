"""The HTTP client of the package huggingface_hub, under the rules of kb.net.session: answers are
bounded in bytes and time, and what is asked of this machine goes through no proxy.
"""

import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from kb.core import clock
from kb.core.config.addresses import in_the_clear, is_loopback
from kb.core.errors import SettingError
from kb.net import limits
from kb.net.certificates import tls

_RANGE = re.compile(r"bytes=(\d{1,18})-(\d{1,18})")
_SLOWEST = 100_000  # bytes a second of a file's range
_TIMEOUT_S = (10.0, 60.0)  # to connect, and between two bytes


def use_own_client(endpoint: str, timeout: tuple[float, float] = _TIMEOUT_S) -> None:
    """Make the package's requests to the hub at `endpoint`, "" for the public one. Raises
    SettingError for one to which its token would go in the clear.
    """
    if endpoint and in_the_clear(endpoint):
        raise SettingError(
            f"HF_ENDPOINT is {endpoint}, which is not https",
            hint="plain http is for services on this machine alone",
        )
    import httpx2
    import huggingface_hub
    from huggingface_hub.utils import _http

    class Bounded(httpx2.SyncByteStream):
        """The bytes of an answer, as they came. Raises ReadError beyond a number or a time."""

        def __init__(self, response: Any, most: int) -> None:
            self._stream, self._most = response.stream, most
            self._end = clock.monotonic() + limits.ANSWER_S + most / _SLOWEST

        def __iter__(self) -> Iterator[bytes]:
            size = 0
            for part in self._stream:
                size += len(part)
                if size > self._most:
                    raise httpx2.ReadError(f"an answer of more than {self._most:,} bytes")
                if clock.monotonic() > self._end:
                    raise httpx2.ReadError("an answer that does not end")
                yield part

        def close(self) -> None:
            self._stream.close()

    def bound(response: Any) -> None:
        if response.headers.get("content-encoding", "identity") != "identity":
            response.close()
            raise httpx2.DecodingError("an answer that is packed, which was not asked for")
        asked = _RANGE.fullmatch(response.request.headers.get("range", ""))
        size = int(asked[2]) - int(asked[1]) + 1 if asked else 0
        response.stream = Bounded(response, max(size, limits.ANSWER_BYTES))

    def client() -> Any:
        return httpx2.Client(
            event_hooks={"request": [_http.hf_request_event_hook], "response": [bound]},
            follow_redirects=True,
            timeout=httpx2.Timeout(timeout[1], connect=timeout[0]),
            headers={"accept-encoding": "identity"},
            verify=tls() or True,
            # What is on this machine is asked directly, also after a redirect.
            mounts=dict.fromkeys((f"all://{host}" for host in here), None),
        )

    here = {"localhost", "127.0.0.1", "[::1]"}
    if is_loopback(endpoint) and ":" not in (own := urlsplit(endpoint).hostname or ""):
        here.add(own)
    huggingface_hub.set_client_factory(client)
