"""A client of Zenodo's legacy deposit API, which its sandbox speaks as well.

Source: https://developers.zenodo.org. Only what a release needs: create, list, upload with md5,
metadata, publish, new version. Every answer that is no success becomes one of kb.core.errors:
401 the token (403 as well where no deposit is named), 400 what the service says field by field, 429
a wait or exit 3 with the time, 5xx and broken connections a few more tries and then exit 3.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

import msgspec
import requests

from kb.core import clock, signals
from kb.core.errors import CredentialRefused, FatalError, QuotaSpent, Retryable, Unreachable
from kb.net.retry import attempt, retry_after
from kb.net.session import Session, failure, host_of, refusal
from kb.store.digests import digest

TRIES = 5
TIMEOUT_S = (10.0, 300.0)  # seconds to connect, and between two bytes of an answer
LONGEST_WAIT = 120  # seconds that a limit may ask for before the run stops instead
LONGEST_LIMIT = 366 * 86_400  # seconds: what asks for more is no time to come back at
PAGE = 100
_GO_ON = "the same command goes on where it stopped"
_SCOPES = "it needs the scopes deposit:write and deposit:actions; the sandbox has tokens of its own"


class _Deposit(msgspec.Struct):
    """What is read of a deposit; the rest of its answer is kept as it came."""

    id: int
    submitted: bool = False
    metadata: dict[str, Any] = {}
    links: dict[str, Any] = {}
    files: list[Any] = []


class _Described(msgspec.Struct):
    """What is read of the answer to new metadata."""

    metadata: dict[str, Any] = {}


class _File(msgspec.Struct):
    """What is read of an uploaded file."""

    filename: str
    id: str
    checksum: str = ""


class _Sent(msgspec.Struct):
    """What a bucket says of a file that it received."""

    checksum: str = ""


class _Wrong(msgspec.Struct):
    """A field that was refused."""

    field: str = "?"
    message: str | None = None
    messages: list[Any] = []


class _Refusal(msgspec.Struct):
    """What an error answer says."""

    message: str = ""
    errors: list[_Wrong] = []


class Gone(FatalError):
    """A deposit that is not there any more."""


class Forbidden(CredentialRefused):
    """The token may not do this to this deposit: it is another account's, or is closed,
    or a scope is missing.
    """


class Damaged(Retryable):
    """The service received other bytes than were sent."""


def stray(url: str) -> FatalError:
    """The error for an address at another host."""
    return FatalError("the deposit service links to another host", hint="nothing was sent there")


class Zenodo:
    """One account at one service. The token goes into the header only, and to that service only."""

    def __init__(self, session: Session, endpoint: str, token: str, *, wait: bool = False) -> None:
        self._session, self._wait = session, wait
        self.root = endpoint.rstrip("/").removesuffix("/api")
        self._base = f"{self.root}/api/deposit/depositions"
        self._headers = {"Authorization": f"Bearer {token}"}

    def create(self, metadata: dict[str, Any]) -> dict[str, Any]:
        """A new draft. Not sent twice: a draft whose answer was lost is found by `drafts`."""
        made: dict[str, Any] = self._json(
            "POST", self._base, shape=_Deposit, json={"metadata": metadata}, once=True
        )
        return made

    def drafts(self) -> list[dict[str, Any]]:
        """The newest unpublished deposits of the account."""
        found: list[dict[str, Any]] = self._json(
            "GET", self._base, shape=list[_Deposit], params={"status": "draft", "size": PAGE}
        )
        return found

    def get(self, number: int) -> dict[str, Any]:
        """A deposit. Raises Gone."""
        found: dict[str, Any] = self._json("GET", f"{self._base}/{number}", shape=_Deposit)
        return found

    def files(self, number: int) -> dict[str, dict[str, Any]]:
        """Name → {"id", "checksum" (md5, hexadecimal), "filesize"} of what was uploaded."""
        found = self._json("GET", f"{self._base}/{number}/files", shape=list[_File])
        return {one["filename"]: one for one in found}

    def remove(self, number: int, file: str) -> None:
        """Remove an uploaded file of a draft; one that is gone already is what was wanted."""
        with contextlib.suppress(Gone):
            self._json("DELETE", f"{self._base}/{number}/files/{file}")

    def upload(self, bucket: str, path: Path, md5: str, sent: Callable[[int], None]) -> None:
        """Put a file into a draft's bucket, again when the service received other bytes.

        `sent` is told the bytes of the file when it is there. Raises FatalError when it never
        arrives whole, and Interrupted in the midst of it: the next run sends the file again.
        """
        size = path.stat().st_size

        def put() -> None:
            with path.open("rb") as file:
                answer = self._request(
                    "PUT",
                    f"{bucket}/{quote(path.name)}",
                    shape=_Sent,
                    data=_Watched(file, size) if size else b"",
                    headers={"Content-Type": "application/octet-stream"},
                )
            if answer.get("checksum", "").removeprefix("md5:") != md5:
                raise Damaged("damaged upload")

        try:
            self._attempt(put)
        except Unreachable as error:
            if not isinstance(error.__cause__, Damaged):
                raise
            raise FatalError(
                f"{path.name} arrived damaged {TRIES} times",
                hint="check the network, then run the same command again",
            ) from None
        sent(size)

    def describe(self, number: int, metadata: dict[str, Any]) -> dict[str, Any]:
        """Set the metadata. Raises FatalError when the service refuses it or
        takes another licence.
        """
        answer: dict[str, Any] = self._json(
            "PUT", f"{self._base}/{number}", shape=_Described, json={"metadata": metadata}
        )
        taken = answer.get("metadata", {}).get("license")
        if str(taken).lower() != metadata["license"]:
            raise FatalError(
                f"the deposit service took the licence {taken!r} instead of"
                f" {metadata['license']!r}",
                hint="look at the draft; it was not published",
            )
        return answer

    def publish(self, number: int) -> dict[str, Any]:
        """Publish a draft: can't be undone. When the answer is lost, the deposit itself tells."""
        try:
            url = f"{self._base}/{number}/actions/publish"
            published: dict[str, Any] = self._json("POST", url, shape=_Deposit, once=True)
            return published
        except (Unreachable, FatalError):
            now = self.get(number)
            if now.get("submitted"):
                return now
            raise

    def new_version(self, number: int) -> dict[str, Any]:
        """The draft of the record's next version, with the files of the last one.

        The service refuses a second draft while one is open; that one is used then.
        """
        try:
            url = f"{self._base}/{number}/actions/newversion"
            latest = _latest(self._json("POST", url, shape=_Deposit, once=True))
        except FatalError:
            latest = _latest(self.get(number))
            if not latest.startswith(self._base):
                raise
        draft: dict[str, Any] = self._json("GET", latest, shape=_Deposit)
        return draft

    # -- requests ----------------------------------------------------------------------------------

    def _json(self, method: str, url: str, *, once: bool = False, **what: Any) -> Any:
        """The answer, of the `shape` that is given."""
        return self._attempt(lambda: self._request(method, url, **what), once=once)

    def _attempt(self, call: Callable[[], Any], *, once: bool = False) -> Any:
        """`once`: what must not be done twice is tried again only when the service refused to
        begin.
        """

        def guarded() -> Any:
            try:
                return call()
            except Retryable as error:
                if once and not error.throttled:
                    raise Unreachable(
                        f"the deposit service did not answer ({error.reason})", hint=_GO_ON
                    ) from None
                raise

        return attempt(guarded, tries=TRIES, patience=math.inf, service="the deposit service")

    def _request(
        self,
        method: str,
        url: str,
        *,
        shape: Any = Any,
        headers: dict[str, str] | None = None,
        **what: Any,
    ) -> Any:
        if host_of(url) != host_of(self.root):
            raise stray(url)
        try:
            # Redirects would carry the token to wherever they point.
            answer = self._session.request(
                method,
                url,
                headers={**self._headers, **(headers or {})},
                allow_redirects=False,
                **what,
            )
        except requests.RequestException as error:
            raise failure(error, url) from None
        if answer.status_code == 401 or (answer.status_code == 403 and url == self._base):
            raise CredentialRefused(
                "the deposit service does not accept ZENODO_TOKEN", hint=_SCOPES
            )
        if answer.status_code == 403:
            raise Forbidden(
                f"the deposit service refused (403): {_message(answer)}",
                hint="look at the draft there, then run the same command again",
            )
        if answer.status_code == 429:
            raise self._limited(answer.headers)
        refused = refusal(answer, url)
        if refused is not None:
            raise refused
        if answer.status_code == 404 and url == self._base:
            raise FatalError(
                f"there is no deposit API at {self.root}", hint="check KB_ZENODO_ENDPOINT"
            )
        if answer.status_code in (404, 410):
            raise Gone(
                f"the deposit service answered {answer.status_code}: {_message(answer)}",
                hint="the deposit may have been removed by hand",
            )
        if not 200 <= answer.status_code < 300:
            raise FatalError(
                f"the deposit service refused ({answer.status_code}): {_message(answer)}",
                hint="correct that, then run the same command again",
            )
        try:
            body = answer.json() if answer.content else {}
            msgspec.convert(body, shape)
        except (ValueError, RecursionError):
            raise Retryable("an answer that is none of the deposit API", unreachable=True) from None
        return body

    def _limited(self, headers: Any) -> Exception:
        """A short wait is waited out, a long one ends the run with the time to come back (or
        --wait).
        """
        now = datetime.now(UTC)  # the service's own clock: KB_NOW does not move it
        seconds = retry_after(headers.get("Retry-After"), headers.get("Date"))
        if seconds is None:
            reset = retry_after(
                headers.get("X-RateLimit-Reset")
            )  # a number as well: seconds since 1970
            seconds = None if reset is None else max(0.0, reset - now.timestamp())
        if seconds is None or seconds <= LONGEST_WAIT or (self._wait and seconds <= LONGEST_LIMIT):
            return Retryable("limited", after=seconds, throttled=True)
        back = now + timedelta(seconds=min(seconds, LONGEST_LIMIT))
        return QuotaSpent(
            f"the deposit service's limit is spent until {clock.stamp(back)}",
            hint="run the same command then",
            reset_at=back,
        )


class _Watched:
    """A file on its way out that stops between two pieces when the run is asked to end."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file, self._size = file, size

    def __len__(self) -> int:
        return self._size

    def __iter__(self) -> Iterator[bytes]:
        return iter(lambda: self.read(1 << 16), b"")

    def read(self, size: int = -1) -> bytes:
        """The next bytes. Raises Interrupted."""
        signals.stop.check()
        return self._file.read(size)


def md5(path: Path) -> str:
    """The checksum that the service compares."""
    return digest(path, "md5")


def _latest(deposit: dict[str, Any]) -> str:
    """The address of a record's open draft, "" when it names none."""
    return str(deposit.get("links", {}).get("latest_draft", ""))


def _message(answer: Any) -> str:
    """What an error answer says, with every field it names."""
    try:
        body = answer.json()
        said = msgspec.convert(body, _Refusal)
    except (ValueError, RecursionError):
        return answer.reason or "no message"
    fields = [
        f"{one.field}: {one.message or ' '.join(map(str, one.messages))}" for one in said.errors
    ]
    return "; ".join([said.message.strip(), *fields])[:600]
