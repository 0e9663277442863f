"""What the raw answers say, the newest first: which pages there are, which was captured, which failed.

Raw folders of several machines may lie in one place, so the order is that of `fetched_at`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kb.store import rawlog, tombstones
from kb.store.rawlog import Envelope

Row = dict[str, Any]


@dataclass
class Page:
    """A page that the wiki names: facts by revision, and what became of showing it."""

    page_id: int
    title: str = ""
    revision_id: int = 0
    infos: dict[int, Row] = field(default_factory=dict)
    captured: dict[tuple[int, str], tuple[str, Row]] = field(default_factory=dict)
    problem: Row | None = None

    @property
    def shown(self) -> tuple[str, Row] | None:
        """(fetched_at, render) of the newest revision under its newest title, when there is one."""
        return self.captured.get((self.revision_id, self.title))


@dataclass
class Index:
    """Everything that the filter needs to know; `missing` is title → reason."""

    pages: dict[int, Page]
    missing: dict[str, str]
    files: dict[str, Row]
    site: Row
    unknown: int = 0


def read_index(root: Path) -> Index:
    """Read all raw kinds once. Tombstoned pages and titles are left out."""
    gone = tombstones.keys(root, "wiki")
    index = Index({}, {}, {}, {})
    left: set[int] = set()
    for envelope in _by_time(root, "pages"):
        _take_pages(index, envelope, left)
    for envelope in _by_time(root, "renders"):
        _take_render(index, envelope)
    for envelope in _by_time(root, "files"):
        index.files[envelope.response["key"]] = envelope.response
    for envelope in _by_time(root, "site"):
        index.site = envelope.response.get("query", {})
    for key in list(index.pages):
        if str(key) in gone or index.pages[key].title in gone or key in left:
            del index.pages[key]
    titles = {page.title for page in index.pages.values()}
    index.missing = {
        title: reason for title, reason in index.missing.items() if title not in titles and title not in gone
    }
    return index


def _by_time(root: Path, kind: str) -> list[Envelope]:
    return sorted(rawlog.read(root, "wiki", kind), key=lambda envelope: envelope.fetched_at or "")


def _take_pages(index: Index, envelope: Envelope, left: set[int]) -> None:
    for page in envelope.response.get("query", {}).get("pages", []):
        revision = (page.get("revisions") or [None])[0]
        key = page.get("pageid")
        if page.get("missing") or page.get("invalid") or page.get("redirect") or not revision:
            if key:
                left.add(int(key))
            if page.get("title"):
                reason = "invalid" if page.get("invalid") else "redirect" if page.get("redirect") else "missing"
                index.missing[page["title"]] = reason
            continue
        left.discard(int(key))
        index.missing.pop(page["title"], None)
        known = index.pages.setdefault(int(key), Page(int(key)))
        known.title, known.revision_id = page["title"], int(revision["revid"])
        known.infos[known.revision_id] = page


def _take_render(index: Index, envelope: Envelope) -> None:
    answer = envelope.response
    page = index.pages.get(int(answer["page_id"]))
    if page is None:
        return
    if answer["outcome"] == "captured":
        page.captured[int(answer["revision_id"]), answer["title"]] = (envelope.fetched_at or "", answer)
    elif answer.get("wanted_revision") == page.revision_id:
        page.problem = answer
