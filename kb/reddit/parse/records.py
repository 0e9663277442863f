"""One post or comment, live or from a dump of any year → a row as a plain dictionary.

HTML entities of a dump's record are resolved once for the whole record. A value that can't be read
is null, and the list `problems` of its row says why: (column, reason, value).
"""

import hashlib
import html
import json
import re
from collections.abc import Callable, Iterable
from html.entities import html5
from typing import Any

from kb.core.config.profile.collecting import Links
from kb.reddit.parse import answer_tree
from kb.reddit.parse.people import PURGED
from kb.reddit.parse.post_types import (
    is_crosspost,
    link_classifier,
    poll_options,
    post_type,
)
from kb.reddit.parse.removal import LATEST, flag, removal, retrieved

_TEXTS = ("title", "selftext", "body")  # what tells whether a record was escaped
_ADDRESSES = ("url", "url_overridden_by_dest")
_NUMBER = re.compile(r"#(?:[0-9]+|[xX][0-9a-fA-F]+)")
_OF_REDDIT = ("&amp;", "&lt;", "&gt;")


def unescaped(text: str) -> str:
    """The only text of a record (a comment's body) with its entities resolved, unless it was never
    escaped.
    """
    return text if "&" not in text or was_never_escaped((text,)) else html.unescape(text)


def was_never_escaped(texts: Iterable[str]) -> bool:
    """Whether one of a record's texts holds what escaping would have replaced."""
    return any("<" in text or ">" in text or _holds_bare(text) for text in texts)


def _holds_bare(text: str) -> bool:
    number = text.count("&")
    if not number or number == sum(map(text.count, _OF_REDDIT)):
        return False
    return not all(map(_begins_entity, text.split("&")[1:]))


def _begins_entity(behind: str) -> bool:
    """Whether an ampersand with this behind it begins an entity."""
    name, end, _ = behind.partition(";")
    return bool(end) and (f"{name};" in html5 or _NUMBER.fullmatch(name) is not None)


def resolve(record: dict[str, Any]) -> dict[str, Any]:
    """The fields of a post or comment of a dump with their entities resolved; the same object where
    nothing changes.

    The post that a crosspost shows is a record of its own. An address that holds a bare `&` stays.
    """
    if was_never_escaped(text for name in _TEXTS if isinstance(text := record.get(name), str)):
        return record
    changed: dict[str, Any] = {
        name: html.unescape(text)
        for name in _TEXTS
        if isinstance(text := record.get(name), str) and "&" in text
    }
    changed |= {
        name: unescaped(address)
        for name in _ADDRESSES
        if isinstance(address := record.get(name), str) and "&" in address
    }
    parents = record.get("crosspost_parent_list")
    if isinstance(parents, list) and parents and isinstance(parents[0], dict):
        changed["crosspost_parent_list"] = [resolve(parents[0]), *parents[1:]]
    poll = record.get("poll_data")
    if isinstance(poll, dict) and isinstance(poll.get("options"), list):
        options = [
            {**option, "text": html.unescape(str(option.get("text", "")))}
            for option in poll["options"]
            if isinstance(option, dict)
        ]
        changed["poll_data"] = {**poll, "options": options}
    return {**record, **changed} if changed else record


Row = dict[str, Any]
NOBODY = frozenset({"", "[deleted]", "[removed]", PURGED})  # names that stand for no author
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
    if gone := removal(data):
        row["gone"], row["gone_value"], row["undated"] = gone.reason, gone.value, not gone.dated
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
    said = flag(value)
    if said is None and value is not None:
        _problem(row, name, value)
    return said


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
