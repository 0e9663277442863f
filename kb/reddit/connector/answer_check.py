"""Whether an answer of status 200 is what was asked for.

Reddit, and what stands before it, also send messages with status 200 (`{"message": "we are
busy"}`). Taken for an answer, one would say that everything that was asked for is gone; so the form
is looked at first.
"""

from __future__ import annotations

from typing import Any

from kb.reddit.parse.tree import is_deeper
from kb.schema.coerce import inner

# Lists and objects within each other: Python reads a thousand, its own calls included; a page of
# Reddit's has 60.
DEEPEST = 955
_LISTINGS = frozenset({"new", "top", "controversial", "hot", "rising", "search"})


def problem(path: str, answer: Any) -> str:
    """What is wrong with the answer to a request of `path`; empty when it holds what was
    asked for.
    """
    if not isinstance(answer, (dict, list)) or not answer:
        return "an empty answer"
    if isinstance(answer, dict):
        errors = answer["json"].get("errors") if isinstance(answer.get("json"), dict) else None
        if errors:
            first = errors[0] if isinstance(errors, list) else errors
            return f"error {first[0] if isinstance(first, list) and first else first}"
        if "error" in answer and "data" not in answer:
            return f"error {answer['error']}"
    if is_deeper(answer, DEEPEST):
        return "an answer nested too deep to be read"
    return (
        ""
        if _expected(path.strip("/").split("/"), answer)
        else "an answer of another form than was asked for"
    )


def _expected(parts: list[str], answer: Any) -> bool:
    if parts[0] == "comments":
        return (
            isinstance(answer, list)
            and len(answer) == 2
            and all(map(_is_listing, answer))
            and "t3" in _kinds(answer[0])
        )
    if parts == ["api", "morechildren"]:
        return _are_things(inner(answer, "json", "data", "things"))
    if parts == ["api", "info"] or (parts[0] == "r" and len(parts) == 3 and parts[2] in _LISTINGS):
        return _is_listing(answer)
    return True


def _is_listing(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and value.get("kind") == "Listing"
        and _are_things(inner(value, "data", "children"))
    )


def _are_things(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_thing, value))


def _is_thing(value: Any) -> bool:
    """A post or comment with its id, or a stub with what it stands for."""
    kind, key, children = (
        inner(value, "kind"),
        inner(value, "data", "id"),
        inner(value, "data", "children"),
    )
    return (
        isinstance(children, list)
        if kind == "more"
        else isinstance(kind, str) and isinstance(key, str) and key != ""
    )


def _kinds(listing: Any) -> set[str]:
    return {child["kind"] for child in listing["data"]["children"]}
