"""What of the wiki's raw data must go, and how a page leaves it: answers, captures, images."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.crawl import purge as frame
from kb.crawl.id_list import IdList
from kb.crawl.session import CrawlSession
from kb.store import purge, purge_plan, rawlog, sidefiles, tombstones
from kb.store.frontier import Frontier
from kb.store.inside import is_inside
from kb.store.layout import BELOW, Layout
from kb.store.purge import Strip, links_of, place_of, verdicts_of
from kb.store.purge_search import Found
from kb.wiki.connector.ids import read_names
from kb.wiki.connector.payloads import PAYLOADS
from kb.wiki.connector.reduce import LEFT
from kb.wiki.connector.source import WikiSource
from kb.wiki.parse import extraction, tables

_PURGED = "purged titles"  # cursor of the frontier
ROWS = (
    *(place_of(name, "page_id") for name in ("wiki/pages", *tables.PARTS)),
    *verdicts_of("wiki"),
    links_of("wiki"),
)


def purge_raw(run: Run, ids: Path | None) -> frame.PurgeKeys:
    """Tombstones, raw segments, captured files and frontier; the keys that must leave the rest too.

    `ids` names pages by id, title or address: lines, Parquet with `page_id` or `title`, or
    MineDojo's JSON. `unknown` of what is said are names that nothing here bears (their tombstones
    keep them away), `bad_lines` can be no page. Raises SettingError (exit 2) when the file can't be
    read, before anything is written.
    """
    named = read_names(ids, run.progress.say) if ids else IdList([])

    def collect(session: CrawlSession) -> frame.PurgeKeys:
        known, unknown, bad = _find(named, session.frontier, session.gone)
        found = _gone(session.frontier) | dict.fromkeys([*known, *unknown], "named")
        return frame.PurgeKeys(found, {"unknown": len(unknown), "bad_lines": bad} if ids else {})

    def remove(session: CrawlSession, keys: frame.PurgeKeys, found: Found) -> None:
        _remove(run.root, session.frontier, keys, found)

    return frame.purge_raw(run, WikiSource(run), collect, exact=("renders",), remove=remove)


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge wiki` would remove, counted. Changes nothing."""
    named = read_names(ids, run.progress.say) if ids else IdList([])
    root = run.root
    with purge_plan.state(root, "wiki", PAYLOADS) as frontier:
        if frontier is None:
            return purge_plan.plan(root, "wiki", {}, lambda kind, envelope, keys: envelope, ())
        known, unknown, bad = _find(named, frontier, tombstones.keys(root, "wiki"))
        keys = {**purge.left_over(root, "wiki"), **_gone(frontier), **dict.fromkeys(known, "named")}
        counts = purge_plan.plan(root, "wiki", keys, _others(root, frontier, keys).strip(), ROWS)
    said = {"unknown": len(unknown), "bad_lines": bad} if ids else {}
    return Summary(counts, **said)


def _gone(frontier: Frontier) -> dict[str, str]:
    return {
        key: str(reason)
        for key, _, reason, _ in frontier.items("pages", "skipped")
        if reason in LEFT
    }


def _find(
    named: IdList, frontier: Frontier, removed: Collection[str]
) -> tuple[set[str], set[str], int]:
    """Keys of named pages that are or were here, names nothing bears, how many can be no page's."""
    pages = {key: page for key, _, _, page in frontier.items("pages")}
    titles = {title: key for key, page in pages.items() for title in page.former}
    titles |= {page.title: key for key, page in pages.items()}
    titles |= {
        title: title
        for key, *_ in frontier.items("info")
        if (title := key.partition(":")[2]) not in titles
    }
    before = frontier.cursor(_PURGED, {}, of=dict[str, str])
    purged = {mark: key for mark, key in before.items() if key in removed}
    known: set[str] = set()
    unknown: set[str] = set()
    bad = named.bad_lines
    for name in named.keys:
        if name in pages or name in named.numbers or name in removed:  # a number is an id first
            (known if name in pages or name in removed else unknown).add(name)
        elif held := _by_title(titles, purged, name):
            known.add(held)
        elif re.search(r"[\[\]{}<>#]", name):
            bad += 1
        else:
            unknown.add(name)
    return known, unknown, bad


def _by_title(titles: dict[str, str], purged: dict[str, str], name: str) -> str | None:
    """The key of a page by its title, which the wiki begins with a capital; of those that were
    purged a digest alone is kept.
    """
    for title in (name, name[:1].upper() + name[1:]):
        if key := titles.get(title) or purged.get(_mark(title)):
            return key
    return None


def _mark(title: str) -> str:
    return hashlib.sha256(title.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Others:
    """What goes with pages: their titles, and the files that only these pages show.

    `files` are addresses, `names` what the wiki calls them, `paths` what was stored of them.
    """

    titles: set[str]
    files: set[str]
    names: set[str]
    paths: set[str]

    def strip(self) -> Strip:
        """How the pages and all of this leave the raw answers."""
        names = {"title": self.titles, "file": self.names, "address": self.files}
        return frame.strip_of("wiki", names)


def _others(root: Path, frontier: Frontier, keys: Collection[str]) -> Others:
    titles = {page.title for key, _, _, page in frontier.items("pages") if key in keys}
    titles |= {key for key in keys if not key.isdigit()}
    shown: dict[bool, dict[str, str | None]] = {True: {}, False: {}}
    paths: dict[bool, set[str]] = {True: set(), False: set()}
    for envelope in rawlog.read(root, "wiki", "renders"):
        answer = envelope.response
        if answer["outcome"] != "captured":
            continue
        gone = str(answer["page_id"]) in keys
        shown[gone] |= {file["key"]: file["title"] for file in answer["files"]}
        folder = root / answer["folder"]
        if is_inside(root, answer["folder"]) and (folder / "extraction.json.zst").exists():
            sprites = extraction.sprites(root, folder)
            paths[gone] |= {str(BELOW.images / f"{name}.png") for name in sprites.values()}
    files = shown[True].keys() - shown[False].keys()
    names = {name for name in shown[True].values() if name} - set(shown[False].values())
    for envelope in rawlog.read(root, "wiki", "files"):
        answer = envelope.response
        if answer.get("path"):
            paths[answer["key"] in files].add(answer["path"])
    # What lies elsewhere was not written by a crawl, whatever the data say: not ours to remove.
    own = {path for path in paths[True] - paths[False] if is_inside(root, path)}
    return Others(titles, files, names, own)


def _remove(root: Path, frontier: Frontier, keys: Collection[str], found: Found) -> None:
    others = _others(root, frontier, keys)
    # What the raw answers and the pages alone tell is done before these go: a purge that was
    # killed has to find it again.
    asked = (key for key, *_ in frontier.items("info"))
    with frontier.transaction():
        frontier.remove("info", [key for key in asked if key.partition(":")[2] in others.titles])
        frontier.remove("files", others.files)
    for path in sorted(others.paths):
        (root / path).unlink(missing_ok=True)
        sidefiles.aside(root / path).unlink(missing_ok=True)
    for key in keys:
        if key.isdigit():
            shutil.rmtree(Layout(root).captures / key, ignore_errors=True)
    purge.rewrite_raw(root, "wiki", keys, others.strip(), frontier, found)
    marks = {
        _mark(title): key
        for key, _, _, page in frontier.items("pages")
        if key in keys
        for title in (page.title, *page.former)
    }
    with frontier.transaction():
        frontier.set_cursor(_PURGED, {**frontier.cursor(_PURGED, {}, of=dict[str, str]), **marks})
        frontier.remove("pages", keys)
