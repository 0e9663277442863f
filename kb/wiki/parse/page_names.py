"""Reads titles, redirects and categories of a crawled wiki's pages from raw answers."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.wiki.parse import answers


class NamedPage(NamedTuple):
    """A page: `prefix` is its namespace's name ("Cookbook"), empty for articles."""

    title: str
    prefix: str
    redirects: tuple[str, ...]
    categories: tuple[str, ...]


def pages(root: Path) -> list[NamedPage]:
    """Every page of the wiki but its front page, by title; the newest answer wins.

    Purged pages and those that are gone are left out. Raises DamagedData.
    """
    spaces, front = _site(root)
    removed = tombstones.keys(root, "wiki")
    newest: dict[str, tuple[str, NamedPage | None]] = {}
    for envelope in rawlog.read(root, "wiki", "pages"):
        query = (envelope.response or {}).get("query") or {}
        for page in query.get("pages", []):
            key, at = str(page.get("pageid", page.get("title"))), envelope.fetched_at or ""
            if at >= newest.get(key, ("", None))[0]:
                there = answers.state(page) == "there" and "redirects" not in query
                newest[key] = (at, _named(page, spaces, removed) if there else None)
    named = [page for key, (_, page) in newest.items() if page is not None and key not in removed]
    return sorted(page for page in named if page.title not in removed and page.title != front)


def _site(root: Path) -> tuple[dict[int, str], str]:
    """Names of namespaces by number, and the front page's title."""
    spaces: dict[int, str] = {}
    front = ""
    for envelope in rawlog.read(root, "wiki", "site"):
        query = (envelope.response or {}).get("query") or {}
        front = query.get("general", {}).get("mainpage", front)
        spaces |= {one["id"]: one.get("name", "") for one in query.get("namespaces", {}).values()}
    return spaces, front


def _named(page: dict[str, Any], spaces: dict[int, str], removed: Collection[str]) -> NamedPage:
    prefix = spaces.get(page.get("ns", 0), "")

    def titles(name: str) -> tuple[str, ...]:
        return tuple(sorted(one["title"] for one in page.get(name, []) if "title" in one))

    categories = tuple(title.partition(":")[2] or title for title in titles("categories"))
    redirects = tuple(title for title in titles("redirects") if title not in removed)
    return NamedPage(page["title"], prefix, redirects, categories)
