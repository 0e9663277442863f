"""Checks the shape of the API's answers and reads the states of pages from them.

Status 200 does not guarantee an answer: a front end may say "busy", an error may have another
shape, an answer may be incomplete. None of these says anything about a page. The shape is therefore
checked first (`problem`), and a page absent from the answer is "unanswered", never "missing".
"""

from collections.abc import Mapping
from typing import Any
from urllib.parse import unquote

SHOWN = 80  # characters of a strange answer that a message quotes


def problem(params: Mapping[str, str | int], answer: Any) -> str | None:
    """What is wrong with the shape of an answer to these parameters; None when it can be used."""
    if not isinstance(answer, dict):
        return f"the API's answer is no object but {quoted(repr(answer))}"
    going = answer.get("continue")
    if going is not None and not (
        isinstance(going, dict) and all(isinstance(value, str | int) for value in going.values())
    ):
        return "the API's answer has a `continue` that can't be followed"
    query = answer.get("query")
    if not isinstance(query, dict):
        return f"the API's answer has no `query` but {quoted(repr(answer))}"
    if params.get("meta") == "siteinfo":
        spaces = query.get("namespaces", {})
        if (
            not isinstance(query.get("general"), dict)
            or not isinstance(spaces, dict)
            or not _all(spaces.values())
        ):
            return "the API's answer does not describe the site"
    if params.get("list") == "allpages" and not _entries(query.get("allpages"), "title"):
        return "the API's answer has no list of pages"
    if params.keys() & {"titles", "pageids", "revids"}:
        return _about_pages(query)
    return None


def quoted(text: str) -> str:
    """The beginning of a strange answer on one line."""
    line = " ".join(text.split())
    return f'"{line[:SHOWN]}…"' if len(line) > SHOWN else f'"{line}"'


def _about_pages(query: dict[str, Any]) -> str | None:
    # Without a single page there must be another answer: titles of other wikis, or revisions that
    # are not there.
    if "pages" not in query and not query.get("interwiki") and not query.get("badrevids"):
        return f"the API's answer has no pages but {quoted(repr(query))}"
    pages = query.get("pages", [])
    if not isinstance(pages, list) or not _all(pages):
        return "the API's answer has no list of pages"
    for page in pages:
        if not isinstance(page.get("title", ""), str) or type(page.get("pageid", 0)) is not int:
            return (
                f"the API's answer holds a page that has neither title nor id: {quoted(repr(page))}"
            )
        if not isinstance(page.get("revisions", []), list) or not _all(page.get("revisions", [])):
            return "the API's answer holds revisions that are no objects"
    if not (
        _entries(query.get("normalized", []), "from", "to")
        and _entries(query.get("interwiki", []), "title")
    ):
        return "the API's answer names titles in a way that can't be read"
    return None


def _all(values: Any) -> bool:
    return all(isinstance(value, dict) for value in values)


def _entries(values: Any, *names: str) -> bool:
    return (
        isinstance(values, list)
        and _all(values)
        and all(isinstance(entry.get(name), str) for entry in values for name in names)
    )


def state(page: dict[str, Any]) -> str:
    """What an answer says of a page: "there", "invalid", "redirect", "missing" or "special".

    "unanswered" when it says none of it.
    """
    flag = next(
        (name for name in ("invalid", "redirect", "missing", "special") if page.get(name)), None
    )
    return flag or ("there" if page.get("revisions") else "unanswered")


def asked(params: dict[str, Any]) -> list[str]:
    """The titles that were asked for."""
    titles = params.get("titles")
    return titles.split("|") if isinstance(titles, str) and titles else []


def elsewhere(query: dict[str, Any]) -> set[str]:
    """Titles that stand for pages of other wikis."""
    return {entry["title"] for entry in query.get("interwiki", [])}


def renamed(query: dict[str, Any]) -> dict[str, str]:
    """How the wiki writes the titles that were asked for, where it writes them otherwise."""
    return {
        unquote(change["from"]) if change.get("fromencoded") else change["from"]: change["to"]
        for change in query.get("normalized", [])
    }
