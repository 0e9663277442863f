"""HTML entities in records of archive dumps, resolved once for a whole record.

Reddit escapes `&`, `<` and `>` in every text that it gives without `raw_json=1`, and most archives
keep its answers so; some hold texts that were never escaped. Of an escaped text every `&` begins an
entity, and no `<` or `>` is left. So a record whose title, selftext or body holds a `<`, a `>` or a
bare `&` was never escaped, and its entities are what somebody wrote; all others are resolved.

A bare `&` is one that begins no entity: `&#` with decimal digits, `&#x` with hexadecimal ones, or
`&` with a name of HTML 5, each up to its `;` (https://html.spec.whatwg.org/#character-references).
"""

import html
import re
from collections.abc import Iterable
from html.entities import html5
from typing import Any

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
