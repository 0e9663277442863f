"""One post or comment, live or from a dump of any year → a row as a plain dictionary.

A value that can't be read is null, and the list `problems` of its row says why: (column, reason,
value).
"""

import hashlib
import json
from collections.abc import Callable
from typing import Any

from kb.core.config.profile.reddit import Links
from kb.reddit.parse import answer_tree
from kb.reddit.parse.html_entities import resolve
from kb.reddit.parse.post_types import (
    is_crosspost,
    link_classifier,
    poll_options,
    post_type,
    removal,
)

Row = dict[str, Any]
LATEST = 253402300800  # seconds of Unix time: the year 10000
NOBODY = frozenset({"", "[deleted]", "[removed]"})  # names that stand for no author
_COLUMNS = {"selftext": "body"}  # fields whose column has another name


class RecordReader:
    """Reads the records of one kind of answers. Only dumps hold HTML entities."""

    def __init__(self, links: Links, *, live: bool) -> None:
        self._live = live
        self._classify: Callable[[str], str] = link_classifier(links)

    def post(self, data: dict[str, Any]) -> Row:
        """The row of a post (a submission's fields of any year)."""
        if not self._live:
            data = resolve(data)
        row = _identified(answer_tree.POST, data)
        row["post_id"] = row["fullname"].partition("_")[2]
        row["type"], row["link_kind"], row["source_url"] = post_type(data, self._classify)
        row["is_crosspost"] = is_crosspost(data)
        row["poll_options"] = poll_options(data)
        row["over_18"] = _flag(row, data, "over_18")
        row["title"] = _text(row, data, "title", required=True)
        row["text"] = _text(row, data, "selftext") or None
        row["num_comments"] = _integer(row, data, "num_comments")
        row["upvote_ratio"] = _ratio(row, data, "upvote_ratio")
        return _with_common(row, data)

    def comment(self, data: dict[str, Any]) -> Row:
        """The row of a comment."""
        if not self._live:
            data = resolve(data)
        row = _identified(answer_tree.COMMENT, data)
        row["post_id"] = answer_tree.bare(data.get("link_id"))
        parent = data.get("parent_id")
        if isinstance(parent, str) and parent.startswith(("t1_", "t3_")):
            row["parent_id"] = parent
        else:  # some years of dumps give a number, or leave it out
            _problem(row, "parent_id", parent)
        row["text"] = _text(row, data, "body", required=True)
        return _with_common(row, data)


def new_row(fullname: str, post: str, state: str) -> Row:
    """A row without values."""
    return {"fullname": fullname, "post_id": post, "state": state, "problems": []}


def retrieved(data: dict[str, Any]) -> int | None:
    """When the archive read a record, in seconds since 1970; None when it doesn't say."""
    for name in ("retrieved_utc", "retrieved_on"):
        value = data.get(name)
        if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20:
            value = int(value)
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < LATEST:
            return int(value)
    return None


def _identified(kind: str, data: dict[str, Any]) -> Row:
    """A row under the record's id. A record without an id gets a key made of its content and the
    state `unknown`; the filter rejects it.
    """
    key = data.get("id")
    if isinstance(key, str) and key:
        return new_row(f"{kind}_{key}", "", "there")
    content = json.dumps(data, sort_keys=True, default=str).encode()
    row = new_row(f"{kind}_unknown-{hashlib.sha256(content).hexdigest()[:16]}", "", "unknown")
    _problem(row, "state", key)
    return row


def _with_common(row: Row, data: dict[str, Any]) -> Row:
    """The columns that posts and comments share."""
    row["retrieved"] = retrieved(data)
    row["score"] = _integer(row, data, "score")
    made = _integer(row, data, "created_utc")
    if made is not None and not 0 <= made < LATEST:
        _problem(row, "created_utc", data["created_utc"])
        made = None
    row["created_utc"] = made
    author = data.get("author")
    row["author_hash"] = author if isinstance(author, str) and author not in NOBODY else None
    row["gone"], row["gone_value"] = removal(data) or (None, None)
    return row


def _problem(row: Row, column: str, value: Any) -> None:
    """Note that a value is absent or can't be read."""
    reason = "absent" if value is None else "malformed"
    row["problems"].append((column, reason, None if value is None else str(value)[:200]))


def _integer(row: Row, data: dict[str, Any], name: str) -> int | None:
    """A whole number; old dumps have times and scores as strings, some as floats."""
    value = data.get(name)
    if value is None:
        return None
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            number = value if isinstance(value, int) else int(float(value))
            if -(1 << 62) < number < 1 << 62:
                return number
        except (ValueError, OverflowError):
            pass
    _problem(row, name, value)
    return None


def _flag(row: Row, data: dict[str, Any], name: str) -> bool | None:
    """Yes or no, also as 1 and 0 or as words. Absent does not mean no."""
    value = data.get(name)
    if value is None or isinstance(value, bool):
        return value
    word = str(value).lower()
    if isinstance(value, (int, str)) and word in ("1", "0", "true", "false"):
        return word in ("1", "true")
    _problem(row, name, value)
    return None


def _ratio(row: Row, data: dict[str, Any], name: str) -> float | None:
    """A share, 0 to 1."""
    value = data.get(name)
    if value is None:
        return None
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            if 0 <= float(value) <= 1:
                return float(value)
        except (ValueError, OverflowError):
            pass
    _problem(row, name, value)
    return None


def _text(row: Row, data: dict[str, Any], name: str, *, required: bool = False) -> str | None:
    """A text; NUL becomes U+FFFD, as a raw log replaces it."""
    value = data.get(name)
    if isinstance(value, str):
        return value if "\0" not in value else value.replace("\0", "�")
    if required or value is not None:
        _problem(row, _COLUMNS.get(name, name), value)
    return None
