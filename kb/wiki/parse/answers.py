"""Checks the shape of the API's answers, and reads states and names of pages from them.

Status 200 does not guarantee an answer: a front end may say "busy", an error may have another
shape, an answer may be incomplete. None of these says anything about a page. The shape is therefore
checked first (`problem`), and a page absent from the answer is "unanswered", never "missing".
"""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar
from urllib.parse import unquote

import msgspec
from msgspec import UNSET, UnsetType

from kb.schema.wiki_page import PageNames
from kb.store.rawlog import rawlog
from kb.store.state import tombstones

SHOWN = 80  # characters of a malformed answer that a message quotes
_Query = TypeVar("_Query")


class _Answer(msgspec.Struct, Generic[_Query], rename={"next": "continue"}):
    query: _Query
    next: dict[str, str | int] | None = None


class _Titled(msgspec.Struct):
    title: str


class _Site(msgspec.Struct):
    general: dict[str, Any]
    namespaces: Annotated[dict[str, dict[str, Any]], msgspec.Meta(max_length=10_000)] = {}


class _List(msgspec.Struct):
    allpages: list[_Titled]


class _Page(msgspec.Struct):
    title: str = ""
    pageid: int = 0
    revisions: list[dict[str, Any]] = []


class _Renamed(msgspec.Struct, rename={"source": "from"}):
    source: str
    to: str


class _Pages(msgspec.Struct):
    pages: list[_Page] | UnsetType = UNSET
    normalized: list[_Renamed] = []
    interwiki: list[_Titled] = []
    badrevids: Any = None


def problem(params: Mapping[str, str | int], answer: Any) -> str | None:
    """What is wrong with the shape of an answer to these parameters; None when it can be used."""
    shape: Any = _Answer[dict[str, Any]]
    if params.get("meta") == "siteinfo":
        shape = _Answer[_Site]
    elif params.get("list") == "allpages":
        shape = _Answer[_List]
    elif params.keys() & {"titles", "pageids", "revids"}:
        shape = _Answer[_Pages]
    try:
        query = msgspec.convert(answer, shape).query
    except msgspec.ValidationError as error:
        return f"the API's answer is malformed ({error}): {quoted(repr(answer))}"
    # Without pages there must be another answer: titles of other wikis, or unknown revisions.
    if (
        isinstance(query, _Pages)
        and query.pages is UNSET
        and not (query.interwiki or query.badrevids)
    ):
        return f"the API's answer has no pages: {quoted(repr(answer))}"
    return None


def quoted(text: str) -> str:
    """The beginning of a malformed answer on one line."""
    line = " ".join(text.split())
    return f'"{line[:SHOWN]}…"' if len(line) > SHOWN else f'"{line}"'


def state(page: dict[str, Any]) -> str:
    """The state of a page: "there", "invalid", "redirect", "missing", "special", "unanswered"."""
    flag = next(
        (name for name in ("invalid", "redirect", "missing", "special") if page.get(name)), None
    )
    return flag or ("there" if page.get("revisions") else "unanswered")


def asked(params: dict[str, Any]) -> list[str]:
    """The requested titles."""
    titles = params.get("titles")
    return titles.split("|") if isinstance(titles, str) and titles else []


def elsewhere(query: dict[str, Any]) -> set[str]:
    """Titles of pages of other wikis."""
    return {entry["title"] for entry in query.get("interwiki", [])}


def renamed(query: dict[str, Any]) -> dict[str, str]:
    """Requested titles that the wiki writes differently or that lead elsewhere, with the title of
    the page.
    """
    names = {
        unquote(change["from"]) if change.get("fromencoded") else change["from"]: change["to"]
        for change in query.get("normalized", [])
    }
    targets = {change["from"]: change["to"] for change in query.get("redirects", [])}
    return targets | {name: targets.get(title, title) for name, title in names.items()}


def named_pages(root: Path) -> dict[str, PageNames]:
    """Every page of the wiki but its front page, in order of the title with its namespace, which is
    the key; the newest answer wins.

    Purged pages and those that are gone are left out. Raises DamagedData.
    """
    spaces, front = _site(root)
    removed = tombstones.keys(root, "wiki")
    newest: dict[str, tuple[str, str, PageNames | None]] = {}
    for envelope in rawlog.envelopes(root, "wiki", "pages"):
        query = (envelope.response or {}).get("query") or {}
        for page in query.get("pages", []):
            key, at = str(page.get("pageid", page.get("title"))), envelope.fetched_at or ""
            if at >= newest.get(key, ("",))[0]:
                called = _names(page, spaces, removed) if state(page) == "there" else None
                newest[key] = (at, page.get("title", ""), called)
    named = {
        title: called
        for key, (_, title, called) in newest.items()
        if called is not None and key not in removed
    }
    return {title: named[title] for title in sorted(named.keys() - {front, *removed})}


def file_names(root: Path) -> list[str]:
    """What the wiki calls its namespace of files, in its own language and in every wiki's."""
    names = {"File", "Image"}
    for envelope in rawlog.envelopes(root, "wiki", "site"):
        query = (envelope.response or {}).get("query") or {}
        space = query.get("namespaces", {}).get("6", {})
        names |= {str(space[name]) for name in ("name", "canonical") if space.get(name)}
        aliases = query.get("namespacealiases", [])
        names |= {
            str(alias["alias"]) for alias in aliases if alias.get("id") == 6 and alias.get("alias")
        }
    return sorted(names)


def _site(root: Path) -> tuple[dict[int, str], str]:
    """Names of namespaces by number, and the front page's title."""
    spaces: dict[int, str] = {}
    front = ""
    for envelope in rawlog.envelopes(root, "wiki", "site"):
        query = (envelope.response or {}).get("query") or {}
        front = query.get("general", {}).get("mainpage", front)
        spaces |= {
            space["id"]: space.get("name", "") for space in query.get("namespaces", {}).values()
        }
    return spaces, front


def titles(page: dict[str, Any], name: str) -> list[str]:
    """The titles in one of a page's lists, sorted."""
    return sorted(entry["title"] for entry in page.get(name) or () if "title" in entry)


def _names(page: dict[str, Any], spaces: dict[int, str], removed: Collection[str]) -> PageNames:
    prefix = f"{spaces.get(page.get('ns', 0), '')}:"
    redirects, categories = (titles(page, name) for name in ("redirects", "categories"))
    return PageNames(
        page["title"].removeprefix(prefix),
        tuple(title.removeprefix(prefix) for title in redirects if title not in removed),
        tuple(title.partition(":")[2] or title for title in categories),
    )
