"""A client of Zenodo's legacy deposit API, which its sandbox speaks as well.

Source: https://developers.zenodo.org. Only what a release needs: create, list, upload with md5,
metadata, publish, new version. Errors are those of kb.release.publish.service.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from kb.core import signals
from kb.core.errors import FatalError, Retryable, Unreachable
from kb.net.session import HttpSession
from kb.release.publish.service import (
    TRIES,
    DepositAnswer,
    DepositService,
    Described,
    Gone,
    Sent,
    UploadedFile,
    latest_draft,
)
from kb.store.tables.checksums import digest

PAGE = 100


class Damaged(Retryable):
    """The service received other bytes than were sent."""


class Zenodo:
    """One account at one service. The token goes into the header only, and to that service only."""

    def __init__(
        self, session: HttpSession, endpoint: str, token: str, *, wait: bool = False
    ) -> None:
        self._service = DepositService(session, endpoint, token, wait=wait)
        self.root, self._base = self._service.root, self._service.base

    def create(self, metadata: dict[str, Any]) -> Any:
        """A new draft. Not sent twice: a draft whose answer was lost is found by `drafts`."""
        return self._service.json(
            "POST", self._base, shape=DepositAnswer, json={"metadata": metadata}, once=True
        )

    def drafts(self) -> Any:
        """The newest unpublished deposits of the account."""
        return self._service.json(
            "GET", self._base, shape=list[DepositAnswer], params={"status": "draft", "size": PAGE}
        )

    def get(self, number: int) -> Any:
        """A deposit. Raises Gone."""
        return self._service.json("GET", f"{self._base}/{number}", shape=DepositAnswer)

    def files(self, number: int) -> dict[str, dict[str, Any]]:
        """Name → {"id", "checksum" (md5, hexadecimal), "filesize"} of what was uploaded."""
        files = self._service.json("GET", f"{self._base}/{number}/files", shape=list[UploadedFile])
        return {one["filename"]: one for one in files}

    def remove(self, number: int, file: str) -> None:
        """Remove an uploaded file of a draft; one that is gone already is what was wanted."""
        with contextlib.suppress(Gone):
            self._service.json("DELETE", f"{self._base}/{number}/files/{quote(file, safe='')}")

    def upload(self, bucket: str, path: Path, md5: str, sent: Callable[[int], None]) -> None:
        """Put a file into a draft's bucket, again when the service received other bytes.

        `sent` is told the bytes of the file when it is there. Raises FatalError when it never
        arrives whole, and Interrupted in the midst of it: the next run sends the file again.
        """
        size = path.stat().st_size

        def put() -> None:
            with path.open("rb") as file:
                answer = self._service.request(
                    "PUT",
                    f"{bucket}/{quote(path.name)}",
                    shape=Sent,
                    data=_Watched(file, size) if size else b"",
                    headers={"Content-Type": "application/octet-stream"},
                )
            if answer.get("checksum", "").removeprefix("md5:") != md5:
                raise Damaged("damaged upload")

        try:
            self._service.attempt(put)
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
        answer = self._service.json(
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
            return self._service.json("POST", url, shape=DepositAnswer, once=True)
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
            latest = latest_draft(self._service.json("POST", url, shape=DepositAnswer, once=True))
        except FatalError:
            latest = latest_draft(self.get(number))
            if not latest.startswith(self._base):
                raise
        return self._service.json("GET", latest, shape=DepositAnswer)


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
