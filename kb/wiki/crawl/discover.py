"""Begins and ends the rounds of a crawl, and reopens items that can succeed now.

A round reads the complete list of pages, or named titles; `--again` starts a new one when the last
is done. At its end, pages that the wiki no longer has become tombstones.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import msgspec

from kb.core import clock
from kb.core.errors import DamagedData
from kb.store.damage import forget_damage
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog, sidefiles
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.wiki import media_urls
from kb.wiki.crawl import reduce
from kb.wiki.crawl.reduce import SiteItem
from kb.wiki.parse.tables import read_extraction
from kb.wiki.section import WikiSection

COMPARED = 3  # other items that are asked for when one is refused


class Round(msgspec.Struct):
    """The cursor of a kind of rounds: "round" for the complete list, "named" for named titles."""

    number: int = 1
    done: bool = False


def begin_round(
    frontier: Frontier, names: list[str] | None, namespaces: Iterable[int], *, again: bool
) -> None:
    """Continue a round, or start one: of the titles `names`, or of the complete list.

    A round of named titles does not change what is known about the list. The titles themselves are
    recorded before (`WikiConnector.seeds`).
    """
    cursor = "round" if names is None else "named"
    current = _round(frontier, cursor)
    if again and current.done:
        current = Round(current.number + 1)
        # What failed in an earlier round fails once: this round asks for the title again.
        failed = [
            key
            for key, _, _, item in frontier.items("info", "error")
            if (not key.startswith("t") if names is None else item.title in names)
        ]
        frontier.remove("info", failed)
    with frontier.transaction():
        frontier.set_cursor(cursor, current)
        tag = str(current.number) if names is None else f"t{current.number}"
        if not current.done and frontier.cursor(reduce.SITE + tag) is None:
            frontier.add_keys("site", [(tag, SiteItem(names is None, tuple(namespaces)))])
        if names is None:
            if not current.done:
                reduce.add_lists(frontier, current.number)
            return
        waiting = frontier.items("info", "todo")
        if not current.done or any(key.startswith(f"{tag}:") for key, *_ in waiting):
            frontier.add_keys("gone", [tag])


def named_tag(frontier: Frontier, *, again: bool) -> str:
    """What stands before the titles of the round of named titles that `begin_round` gives."""
    current = _round(frontier, "named")
    return f"t{current.number + (again and current.done)}"


def finish_round(frontier: Frontier, root: Path, tag: str) -> None:
    """Finish a round whose items were all answered."""
    write_tombstones(frontier, root)
    cursor = "round" if tag.isdigit() else "named"
    number = int(tag.removeprefix("t"))
    with frontier.transaction():
        if number == _round(frontier, cursor).number:
            frontier.set_cursor(cursor, Round(number, done=True))
        frontier.remove("gone", [tag])


def _round(frontier: Frontier, cursor: str) -> Round:
    return frontier.cursor(cursor, {}, of=Round)


def unlisted(frontier: Frontier, number: int) -> list[str]:
    """Pages missing from the list of a round: deleted, moved, or turned into a redirect."""
    return [
        key
        for key, status, reason, page in frontier.items("pages")
        if page.round < number and not (status == "skipped" and reason in reduce.LEFT)
    ]


def unnamed(frontier: Frontier, tag: str) -> list[str]:
    """Known pages whose named titles no longer have a page: deleted or moved."""
    titles = {
        item.title
        for key, _, _, item in frontier.items("info", "skipped")
        if key.startswith(f"{tag}:")
    }
    titles |= {title[:1].upper() + title[1:] for title in titles}  # as most wikis write them
    known = frontier.items("pages", "done", "todo", "error")
    return [key for key, _, _, page in known if page.title in titles]


def write_tombstones(frontier: Frontier, root: Path) -> None:
    """Write tombstones: by id for a page that disappeared, by title for a title that a page left.

    A tombstone is lifted when the wiki shows the page again, unless the page was purged meanwhile:
    the frontier has forgotten it, so the crawl treats it as a new page with a tombstone.
    """
    rows: list[tuple[str, str]] = []
    back: set[str] = set()
    titles: set[str] = set()
    for key, status, reason, page in frontier.items("pages"):
        if status == "skipped" and reason in reduce.LEFT:
            rows.append((key, str(reason)))
        else:
            titles.add(page.title)
            if page.gone:
                back.add(key)
        rows += [(title, "moved") for title in page.former]
    tombstones.lift(root, "wiki", back | titles, reduce.LEFT)
    rows = [row for row in rows if row[0] not in titles]
    if rows:
        tombstones.add_tombstones(root, "wiki", rows)


class Comparison(NamedTuple):
    """Another page or file to ask for. `page_id` is None for the front page and for files."""

    url: str
    page_id: int | None
    answered_before: bool


def other_pages(frontier: Frontier, key: str, front: str) -> list[Comparison]:
    """Pages to compare a refused one with: captured ones, else waiting ones, drawn at random; the
    front page if there is no other.
    """
    rng = clock.rng("others", key, clock.monotonic())
    for status in ("done", "todo"):
        pages = sorted(
            Comparison(page.url, int(other), status == "done")
            for other, _, _, page in frontier.items("pages", status)
            if other != key
        )
        if pages:
            return rng.sample(pages, min(COMPARED, len(pages)))
    return [Comparison(front, None, answered_before=False)]


def other_files(
    frontier: Frontier, url: str, served: Iterable[str], reached: Callable[[str], str] = str
) -> list[Comparison]:
    """Files of the same host that were stored, to compare a refused one with, drawn at random.
    `served` are URLs of some that the frontier does not know yet. `reached` gives the URL at which
    a recorded one is reached now.
    """
    host = urlsplit(url).netloc
    recorded = (
        reached(source)
        for key, _, _, file in frontier.items("files", "done")
        for source in media_urls.sources(key, file.src if file else None)[:1]
    )
    stored = sorted(
        source
        for source in {*recorded, *served}
        if urlsplit(source).netloc == host and source != url
    )
    rng = clock.rng("others", url, clock.monotonic())
    drawn = rng.sample(stored, min(COMPARED, len(stored)))
    return [Comparison(source, None, answered_before=True) for source in drawn]


def reopen_larger(frontier: Frontier, section: WikiSection) -> None:
    """Reopen pages that were too large if the profile now allows their size."""
    for key, _, reason, page in list(frontier.items("pages", "skipped")):
        if page.final is None or reason not in reduce.TOO_LARGE:
            continue
        # The height of a page is known; of its elements only that there were too many.
        least = int(page.final[3] or 0) + (reason == "too_many_elements")
        if least <= getattr(section, reduce.TOO_LARGE[reason]):
            with frontier.transaction():
                frontier.payload("pages", key, msgspec.structs.replace(page, final=None))
                frontier.mark("pages", [key], "todo")


def reopen_lost(frontier: Frontier, root: Path) -> None:
    """Reopen the items of side files that are missing or damaged.

    A page with an intact capture is captured again for a lost sprite. Damaged files are moved to
    quarantine, because their replacements may have other names.
    """
    lost = sidefiles.suspects(root)
    if lost:
        pages = {
            Path(path).relative_to(BELOW.captures).parts[0]
            for path in lost
            if Path(path).is_relative_to(BELOW.captures)
        }
        names = {Path(path).stem for path in lost}
        for key, content in _captured_pages(frontier, root):
            if content is None or names.intersection(content["sprites"].values()):
                pages.add(key)
        files = {
            envelope.response["key"]
            for envelope in rawlog.envelopes(root, "wiki", "files")
            if envelope.response.get("path") in lost
        }
        with frontier.transaction():
            for kind, keys in (("pages", pages), ("files", files)):
                done = {key for key, *_ in frontier.items(kind, "done")}
                frontier.mark(kind, sorted(keys & done), "todo")
        for path in lost:
            sidefiles.quarantine_file(root / path)
    forget_damage(root, Layout(root).captures, Layout(root).images)


def _captured_pages(frontier: Frontier, root: Path) -> Iterator[tuple[str, dict[str, Any] | None]]:
    """Page ids with their extractions; None for one that can't be read."""
    for key, _, _, page in list(frontier.items("pages", "done")):
        if page.rendered is not None:
            try:
                yield (
                    key,
                    read_extraction(root, Layout(root).captures / key / str(page.rendered[0])),
                )
            except DamagedData:
                yield key, None
