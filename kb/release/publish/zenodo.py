"""A client of Zenodo's legacy deposit API, which its sandbox speaks as well.

Source: https://developers.zenodo.org. Only what a release needs: create, list, upload with md5,
metadata, publish, new version. Every answer that is no success becomes one of kb.core.errors: 401
the token (403 as well where no deposit is named), 400 what the service says field by field, 429 a
wait or exit 3 with the time, 5xx and broken connections a few more tries and then exit 4.
"""

import contextlib
import json
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
from kb.net import redact
from kb.net.retry import attempt, retry_after
from kb.net.session import HttpSession, failure, host_of, refusal
from kb.store.tables.checksums import digest

PAGE = 100


class Damaged(Retryable):
    """The service received other bytes than were sent."""


class Zenodo:
    """One account at one service. The token goes into the header only, and to that service only."""

    def __init__(
        self, session: HttpSession, endpoint: str, token: str, *, wait: bool = False
    ) -> None:
        self._session, self._wait = session, wait
        self.root = endpoint.rstrip("/").removesuffix("/api")
        self._base = f"{self.root}/api/deposit/depositions"
        self._token = token
        self._headers = {"Authorization": f"Bearer {token}"}

    def create(self, metadata: dict[str, Any]) -> Any:
        """A new draft. Not sent twice: a draft whose answer was lost is found by `drafts`."""
        return self._json(
            "POST", self._base, shape=DepositAnswer, json={"metadata": metadata}, once=True
        )

    def drafts(self) -> Any:
        """The newest unpublished deposits of the account."""
        return self._json(
            "GET", self._base, shape=list[DepositAnswer], params={"status": "draft", "size": PAGE}
        )

    def get(self, number: int) -> Any:
        """A deposit. Raises Gone."""
        return self._json("GET", f"{self._base}/{number}", shape=DepositAnswer)

    def files(self, number: int) -> dict[str, dict[str, Any]]:
        """Name → {"id", "checksum" (md5, hexadecimal), "filesize"} of what was uploaded."""
        files = self._json("GET", f"{self._base}/{number}/files", shape=list[UploadedFile])
        return {file["filename"]: file for file in files}

    def remove(self, number: int, file: str) -> None:
        """Remove an uploaded file of a draft; one that is gone already is what was wanted."""
        with contextlib.suppress(Gone):
            self._json("DELETE", f"{self._base}/{number}/files/{quote(file, safe='')}")

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
                    shape=Sent,
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

    def describe(self, number: int, metadata: dict[str, Any]) -> Any:
        """Set the metadata. Raises FatalError when the service refuses it or
        takes another licence.
        """
        answer = self._json(
            "PUT", f"{self._base}/{number}", shape=Described, json={"metadata": metadata}
        )
        taken = answer.get("metadata", {}).get("license")
        if not isinstance(taken, str) or taken.lower() != metadata["license"]:
            shown = repr(taken[:100]) if isinstance(taken, str) else "of another form"
            raise FatalError(
                f"the deposit service took the licence {shown} instead of {metadata['license']!r}",
                hint="check the draft; it was not published",
            )
        return answer

    def publish(self, number: int) -> Any:
        """Publish a draft: can't be undone. When the answer is lost, the deposit itself tells."""
        try:
            url = f"{self._base}/{number}/actions/publish"
            return self._json("POST", url, shape=DepositAnswer, once=True)
        except (Unreachable, FatalError):
            now = self.get(number)
            if now.get("submitted"):
                return now
            raise

    def new_version(self, number: int) -> Any:
        """The draft of the record's next version, with the files of the last one.

        The service refuses a second draft while one is open; that one is used then.
        """
        try:
            url = f"{self._base}/{number}/actions/newversion"
            latest = latest_draft(self._json("POST", url, shape=DepositAnswer, once=True))
        except FatalError:
            latest = latest_draft(self.get(number))
            if not latest.startswith(self._base):
                raise
        return self._json("GET", latest, shape=DepositAnswer)

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
        """One request. Raises what its answer means."""
        if not self._is_ours(url):
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
        # What it says may reach a terminal and a file: never our token.
        content = answer.content.replace(self._token.encode(), redact.MARK.encode())
        if answer.is_redirect or 300 <= answer.status_code < 400:
            raise FatalError(
                f"the deposit service redirects ({answer.status_code})",
                hint="nothing was sent there; check KB_ZENODO_ENDPOINT",
            )
        text = message(content, str(answer.reason or "").replace(self._token, redact.MARK))
        if answer.status_code == 401 or (answer.status_code == 403 and url == self._base):
            raise CredentialRefused("the deposit service does not accept ZENODO_TOKEN", hint=SCOPES)
        if answer.status_code == 403:
            raise Forbidden(
                f"the deposit service refused (403): {text}",
                hint="check the draft there, then run the same command again",
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
                f"the deposit service answered {answer.status_code}: {text}",
                hint="the deposit may have been deleted manually",
            )
        if not 200 <= answer.status_code < 300:
            raise FatalError(
                f"the deposit service refused ({answer.status_code}): {text}",
                hint="correct that, then run the same command again",
            )
        try:
            body = json.loads(content) if content else {}
            msgspec.convert(body, shape)
        except (ValueError, RecursionError):
            raise Retryable("an invalid answer of the deposit API", unreachable=True) from None
        return body

    def _is_ours(self, url: str) -> bool:
        """Whether an address that the service gave is one of its own."""
        try:
            return host_of(url) == host_of(self.root)
        except ValueError:
            return False  # no address at all

    def _limited(self, headers: Any) -> Exception:
        """A short limit is waited for; a long one ends the run with the time to come back."""
        now = datetime.now(UTC)  # the service's own clock: KB_NOW does not move it
        seconds = retry_after(headers.get("Retry-After"), headers.get("Date"))
        if seconds is None:
            with contextlib.suppress(ValueError):
                reset = float(headers.get("X-RateLimit-Reset", ""))  # seconds since 1970
                if math.isfinite(reset):
                    seconds = min(max(0.0, reset - now.timestamp()), LONGEST_LIMIT)
        if seconds is None or seconds <= LONGEST_WAIT or (self._wait and seconds < LONGEST_LIMIT):
            return Retryable("limited", after=seconds, throttled=True)
        back = now + timedelta(seconds=seconds)
        return QuotaSpent(
            f"the deposit service's limit is spent until {clock.stamp(back)}",
            hint="run the same command then",
            until=back,
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
        signals.stop.raise_if_asked()
        return self._file.read(size)


def md5(path: Path) -> str:
    return digest(path, "md5")


TRIES = 5
TIMEOUT_S = (10.0, 300.0)  # seconds to connect, and between two bytes of an answer
LONGEST_WAIT = 120  # seconds that a limit may ask for before the run stops instead
LONGEST_LIMIT = 366 * 86_400  # seconds: a longer wait is read as this, and never waited for
_GO_ON = "the same command resumes"
SCOPES = "it needs the scopes deposit:write and deposit:actions; the sandbox has tokens of its own"
_SHOWN = 600  # characters of a message


class DepositAnswer(msgspec.Struct):
    """What is read of a deposit; the rest of its answer is kept as it came."""

    id: int
    submitted: bool = False
    metadata: dict[str, Any] = {}
    links: dict[str, Any] = {}
    files: list[Any] = []


class Described(msgspec.Struct):
    """What is read of the answer to new metadata."""

    metadata: dict[str, Any] = {}


class UploadedFile(msgspec.Struct):
    """What is read of an uploaded file."""

    filename: str
    id: str
    checksum: str = ""


class Sent(msgspec.Struct):
    """What a bucket says of a file that it received."""

    checksum: str = ""


class RefusedField(msgspec.Struct):
    """A field that was refused."""

    field: str = "?"
    message: str | None = None
    messages: list[Any] = []


class Refusal(msgspec.Struct):
    """What an error answer says."""

    message: str = ""
    errors: list[RefusedField] = []


class Gone(FatalError):
    """A deposit that is not there any more."""


class Forbidden(CredentialRefused):
    """The token may not do this to this deposit: it is another account's, or is closed,
    or a scope is missing.
    """


def stray(url: str) -> FatalError:
    return FatalError("the deposit service links to another host", hint="nothing was sent there")


def latest_draft(deposit: dict[str, Any]) -> str:
    """The address of a record's open draft, "" when it names none."""
    return str(deposit.get("links", {}).get("latest_draft", ""))


def doi(shown: dict[str, Any]) -> str | None:
    """The identifier that the service gave, or reserves for a draft; None where it gave none."""
    reserved = shown.get("metadata", {}).get("prereserve_doi", {})
    return _text(shown.get("doi")) or _text(reserved.get("doi"))


def page(shown: dict[str, Any]) -> str | None:
    """Where a person looks at the deposit."""
    return _text(shown.get("links", {}).get("html"))


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value else None


def message(content: bytes, reason: str) -> str:
    """What an error answer says, with every field it names; `reason` where it says nothing."""
    try:
        text = msgspec.convert(json.loads(content), Refusal)
        fields = [
            f"{error.field}: {error.message or ' '.join(map(str, error.messages))}"
            for error in text.errors
        ]
    except (ValueError, RecursionError):
        return (reason or "no message")[:_SHOWN]
    return "; ".join([text.message.strip(), *fields])[:_SHOWN]
