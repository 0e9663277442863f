"""Rules of a purge for the wiki: how a page leaves answers, captures and images."""

import hashlib
from collections.abc import Collection

from kb.artifacts.purge import Purge, PurgeRules, with_named
from kb.artifacts.purge_named import KNOWN, NAMED, UNKNOWN
from kb.artifacts.purge_raw import AnswerRules, Names
from kb.artifacts.purge_rows import location_of, shared_locations
from kb.store.layout import BELOW
from kb.store.rawlog import rawlog, sidefiles
from kb.store.rawlog.sidefiles import is_captured_path
from kb.store.state import tombstones
from kb.wiki.crawl.ids import NAMES
from kb.wiki.crawl.reduce import LEFT
from kb.wiki.parse import tables

_PURGED = "purged titles"  # cursor of the frontier


def find_left(purge: Purge) -> dict[str, str]:
    """What the user named, and pages that the wiki deleted or moved."""
    skipped = purge.frontier.items("pages", "skipped")
    left = {key: str(reason) for key, _, reason, _ in skipped if reason in LEFT}
    return with_named(look_up(purge), left)


def look_up(purge: Purge) -> dict[str, str]:
    """Pages that are named by id, title or address; a name that no page has stands for itself."""
    if purge.listed is None:
        return {}
    frontier, removed = purge.frontier, tombstones.keys(purge.root, "wiki")
    pages = {key: page for key, _, _, page in frontier.items("pages")}
    titles = {title: key for key, page in pages.items() for title in page.former}
    titles |= {page.title: key for key, page in pages.items()}
    asked = {key.partition(":")[2] for key, *_ in frontier.items("info")}
    before = frontier.cursor(_PURGED, {}, of=dict[str, str])
    purged = {mark: key for mark, key in before.items() if key in removed}
    numbers = getattr(purge.listed, "numbers", ())
    states: dict[str, str] = {}
    for name in purge.listed.keys:
        key = name
        if not (name in pages or name in numbers or name in removed):  # a number is an id first
            # The wiki begins titles with a capital; of purged pages only digests are kept. A title
            # that was asked for and has no page is its own key.
            spelled = (name, name[:1].upper() + name[1:])
            keys = (titles.get(title) or purged.get(_mark(title)) for title in spelled)
            own = next((spelling for spelling in spelled if spelling in asked), name)
            key = next(filter(None, keys), own)
        here = key in pages or key in asked
        states[key] = KNOWN if key in removed else NAMED if here else UNKNOWN
    return states


def _mark(title: str) -> str:
    return hashlib.sha256(title.encode()).hexdigest()[:16]


def names(purge: Purge) -> Names:
    """Titles of the pages, and files that only these pages show, by name and address.

    Files, captures and what the state knows of them are removed here: an interrupted purge can only
    find them while the raw answers and the pages are complete.
    """
    root, frontier, keys = purge.root, purge.frontier, purge.keys
    titles = {page.title for key, _, _, page in frontier.items("pages") if key in keys}
    titles |= {key for key in keys if not key.isdigit()}
    titles |= {title[:1].lower() + title[1:] for title in titles}  # as a list may spell them
    shown: dict[bool, dict[str, str | None]] = {True: {}, False: {}}
    paths: dict[bool, set[str]] = {True: set(), False: set()}
    for envelope in rawlog.envelopes(root, "wiki", "renders"):
        answer = envelope.response
        if answer["outcome"] != "captured":
            continue
        removed = str(answer["page_id"]) in keys
        shown[removed] |= {file["key"]: file["title"] for file in answer["files"]}
        folder = root / answer["folder"]
        if is_captured_path(answer["folder"]) and (folder / "extraction.json.zst").exists():
            sprites = tables.read_extraction(root, folder)["sprites"]
            paths[removed] |= {str(BELOW.images / f"{name}.png") for name in sprites.values()}
    addresses = shown[True].keys() - shown[False].keys()
    files = {name for name in shown[True].values() if name} - set(shown[False].values())
    for envelope in rawlog.envelopes(root, "wiki", "files"):
        answer = envelope.response
        if answer.get("path"):
            paths[answer["key"] in addresses].add(answer["path"])
    if not purge.dry:
        asked = [key for key, *_ in frontier.items("info") if key.partition(":")[2] in titles]
        with frontier.transaction():
            frontier.remove("info", asked)
            frontier.remove("files", addresses)
        for path in sorted(paths[True] - paths[False]):
            sidefiles.remove_image(root, path)
        for key in filter(str.isdigit, keys):
            sidefiles.remove_page(root, key)
    return {"title": titles, "file": files, "address": addresses}


def forget(purge: Purge) -> None:
    """Remove pages from the state; of their titles only digests stay, so that they are known."""
    frontier = purge.frontier
    marks = {
        _mark(title): key
        for key, _, _, page in frontier.items("pages")
        if key in purge.keys
        for title in (page.title, *page.former)
    }
    with frontier.transaction():
        frontier.set_cursor(_PURGED, {**frontier.cursor(_PURGED, {}, of=dict[str, str]), **marks})
        frontier.remove("pages", purge.keys)


def any_answer(keys: Collection[str]) -> None:
    """Answers name pages by their titles, so any may have a key."""


RULES = PurgeRules(
    "wiki",
    NAMES.some_ids_in,
    rows=(
        *(location_of(name, "page_id") for name in ("wiki/pages", *tables.PARTS)),
        *shared_locations("wiki"),
    ),
    answers=AnswerRules(texts=any_answer, names=names),
    find=find_left,
    forget=forget,
)
