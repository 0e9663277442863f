"""What is read of the deposit service's answers."""

from __future__ import annotations

from typing import Any

import msgspec


class Deposit(msgspec.Struct):
    """What is read of a deposit; the rest of its answer is kept as it came."""

    id: int
    submitted: bool = False
    metadata: dict[str, Any] = {}
    links: dict[str, Any] = {}
    files: list[Any] = []


class Described(msgspec.Struct):
    """What is read of the answer to new metadata."""

    metadata: dict[str, Any] = {}


class File(msgspec.Struct):
    """What is read of an uploaded file."""

    filename: str
    id: str
    checksum: str = ""


class Sent(msgspec.Struct):
    """What a bucket says of a file that it received."""

    checksum: str = ""


class Wrong(msgspec.Struct):
    """A field that was refused."""

    field: str = "?"
    message: str | None = None
    messages: list[Any] = []


class Refusal(msgspec.Struct):
    """What an error answer says."""

    message: str = ""
    errors: list[Wrong] = []


def latest_draft(deposit: dict[str, Any]) -> str:
    """The address of a record's open draft, "" when it names none."""
    return str(deposit.get("links", {}).get("latest_draft", ""))


def message(answer: Any) -> str:
    """What an error answer says, with every field it names."""
    try:
        body = answer.json()
        said = msgspec.convert(body, Refusal)
    except (ValueError, RecursionError):
        return answer.reason or "no message"
    fields = [
        f"{one.field}: {one.message or ' '.join(map(str, one.messages))}" for one in said.errors
    ]
    return "; ".join([said.message.strip(), *fields])[:600]
