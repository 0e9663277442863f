"""Raw answers by hand: literal posts and comments as the services give them."""

from pathlib import Path
from typing import Any

from kb.store.rawlog.rawlog import Envelope, Request, Segment, encode, folder

MADE = {
    "created_utc": 1_700_000_000,
    "title": "a title",
    "selftext": "",
    "is_self": True,
    "over_18": False,
    "score": 9,
    "num_comments": 0,
    "author": "0" * 32,
}
SAID = {
    "created_utc": 1_700_000_000,
    "body": "words",
    "score": 1,
    "author": "1" * 32,
    "link_id": "t3_good",
    "parent_id": "t3_good",
}


def post(key: str, **fields: Any) -> dict[str, Any]:
    """A text post that every stage keeps, but for `fields`; "LEFT OUT" takes one away."""
    return {
        "kind": "t3",
        "data": {
            name: value
            for name, value in {"id": key, **MADE, **fields}.items()
            if value != "LEFT OUT"
        },
    }


def comment(key: str, **fields: Any) -> dict[str, Any]:
    """A comment on the post `good`, but for `fields`; "LEFT OUT" takes one away."""
    return {
        "kind": "t1",
        "data": {
            name: value
            for name, value in {"id": key, **SAID, **fields}.items()
            if value != "LEFT OUT"
        },
    }


def listing(*things: dict[str, Any], after: str | None = None) -> dict[str, Any]:
    """A Listing of things."""
    return {"kind": "Listing", "data": {"after": after, "children": list(things)}}


def write(
    root: Path,
    kind: str,
    params: dict[str, Any],
    answer: Any,
    at: str | None = "2026-11-20T00:00:00Z",
) -> None:
    """One answer as a segment of its own."""
    segment = Segment(folder(root, "reddit", kind))
    segment.append(encode(Envelope(at, Request(kind, params), 200, answer)))
    segment.close()
