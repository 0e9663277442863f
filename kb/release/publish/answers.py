"""What is read of the deposit service's answers."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import requests

from kb.core.errors import FatalError

MOST = 64 << 20  # bytes of an answer
_SHOWN = 600  # characters of a message
_LONGEST = 2_000  # characters of an identifier or address


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


def latest_draft(deposit: dict[str, Any]) -> str:
    """The address of a record's open draft, "" when it names none."""
    return str(deposit.get("links", {}).get("latest_draft", ""))


def doi(shown: dict[str, Any]) -> str | None:
    """The identifier that the service gave, None where it gave none."""
    return _text(shown.get("doi"))


def page(shown: dict[str, Any]) -> str | None:
    """Where a person looks at the deposit."""
    return _text(shown.get("links", {}).get("html"))


def _text(value: Any) -> str | None:
    return value[:_LONGEST] if isinstance(value, str) and value else None


def message(content: bytes, reason: str) -> str:
    """What an error answer says, with every field it names; `reason` where it says nothing."""
    try:
        said = msgspec.convert(json.loads(content), Refusal)
        fields = [
            f"{one.field}: {one.message or ' '.join(map(str, one.messages))}" for one in said.errors
        ]
    except (ValueError, RecursionError):
        return (reason or "no message")[:_SHOWN]
    return "; ".join([said.message.strip(), *fields])[:_SHOWN]


def content_of(answer: requests.Response) -> bytes:
    """The bytes of an answer. Raises FatalError for more than any answer of the API has."""
    pieces, size = [], 0
    for piece in answer.iter_content(1 << 16):
        size += len(piece)
        if size > MOST:
            raise FatalError(
                f"the deposit service answered with more than {MOST >> 20} MB",
                hint="check KB_ZENODO_ENDPOINT",
            )
        pieces.append(piece)
    return b"".join(pieces)
