"""Answers of Reddit → the things in them, whatever their form, and how comments hang together.

Forms (recorded in tests): a Listing (listings, search, info); two Listings (a post's page: the
post, then nested comments); `json.data.things` (morechildren, flat); dumps are written as Listings.

A person's name reaches an answer as a keyed hash (anonymize). In place of the hash of someone who
asked to be left out stands PURGED, from the moment an answer is scrubbed, or when a purge takes
them out of older ones. That marks what is theirs; where others' records only mention them it
stays.
"""

from collections.abc import Container, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope

POST, COMMENT = "t3", "t1"


class Thing(NamedTuple):
    """A post (`t3`), a comment (`t1`) or a stub (`more`) with its fields."""

    kind: str
    data: dict[str, Any]


def things(response: Any) -> Iterator[Thing]:
    """Every post, comment and stub of an answer, nested replies too, parents before replies.

    Without recursion: trees are as deep as people wish.
    """
    stack: list[Any] = [response]
    while stack:
        value = stack.pop()
        if isinstance(value, list):
            stack.extend(reversed(value))
            continue
        if not isinstance(value, dict):
            continue
        kind, data = value.get("kind"), value.get("data")
        if kind == "Listing" and isinstance(data, dict):
            stack.append(data.get("children"))
        elif kind in (POST, COMMENT, "more") and isinstance(data, dict):
            yield Thing(kind, data)
            if kind == COMMENT and (replies := data.get("replies")):
                stack.append(replies)
        elif isinstance(value.get("json"), dict):
            inner = value["json"].get("data")
            stack.append(inner.get("things") if isinstance(inner, dict) else None)


def after(response: Any) -> str | None:
    """The next page of a listing; None on the last one."""
    data = response.get("data") if isinstance(response, dict) else None
    token = data.get("after") if isinstance(data, dict) else None
    return token if isinstance(token, str) and token else None


def stub_ids(data: Mapping[str, Any]) -> list[str]:
    """Bare ids of the comments behind a `more` stub; none for "continue this thread"."""
    children = data.get("children")
    return (
        [child for child in children if isinstance(child, str)]
        if isinstance(children, list)
        else []
    )


def is_continuation(data: Mapping[str, Any]) -> bool:
    """Whether the stub means "continue this thread": its replies are under its parent's own
    page.
    """
    return not stub_ids(data) and isinstance(data.get("parent_id"), str)


def outside(made: Any, since: float | None, until: float | None) -> bool:
    """Whether something was made before `since`, or at `until` or later (all in seconds of Unix
    time); what doesn't say when is inside.
    """
    if isinstance(made, bool) or not isinstance(made, (int, float)):
        return False
    return (since is not None and made < since) or (until is not None and made >= until)


def bare(fullname: Any) -> str:
    """An id without its `t1_` or `t3_`; empty when there is none."""
    return fullname.partition("_")[2] if isinstance(fullname, str) else ""


def named(value: Any, names: Container[str]) -> bool:
    """Whether a value is one of these full names; an answer may hold anything in a name's place."""
    return isinstance(value, str) and value in names


def depths(parents: Iterable[tuple[str, str | None]]) -> dict[str, int | None]:
    """Depth of each comment from (bare id, full name of the parent) pairs, any order.

    0 for an answer to the post, null when an ancestor is unknown (or the chain is a ring).
    """
    parent = dict(parents)
    known: dict[str, int | None] = {
        key: None if above is None else 0
        for key, above in parent.items()
        if above is None or above.startswith("t3_")
    }
    for start, above in parent.items():
        if start in known:
            continue
        chain = [start]
        key = bare(above)
        if key not in known:
            walked = {start}
            while key in parent and key not in known and key not in walked:
                chain.append(key)
                walked.add(key)
                key = bare(parent[key])
        base = known.get(key)  # None as well where nothing is known of it, and in a ring
        for name in reversed(chain):
            base = None if base is None else base + 1
            known[name] = base
    return known


PURGED = "[purged]"


def theirs(answer: Any) -> set[str]:
    """Full names of what such people posted or commented, and of their posts that others' comments
    and crossposts show. PURGED is among them for a record that has no id.
    """
    names = set()
    for kind, data in things(answer):
        if data.get("author") == PURGED:
            key = data.get("id")
            names.add(f"{kind}_{key}" if isinstance(key, str) and key else PURGED)
        link, parents = data.get("link_id"), data.get("crosspost_parent_list")
        if data.get("link_author") == PURGED and isinstance(link, str):
            names.add(link)
        for parent in parents if isinstance(parents, list) else ():
            if isinstance(parent, dict) and parent.get("author") == PURGED:
                names.add(f"{POST}_{parent.get('id')}")
    return names


def without_hashes(envelope: Envelope, people: Iterable[str]) -> Envelope:
    """The envelope with PURGED in place of these hashes; the same object when it has none."""
    line = rawlog.encode(envelope)
    hashes = [mark.encode() for mark in people if mark.encode() in line]
    for mark in hashes:
        line = line.replace(mark, PURGED.encode())
    return rawlog.decode(line) if hashes else envelope
