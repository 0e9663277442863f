"""Fetches each kind of item from the wiki, as answers to be recorded."""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

from kb.core import signals
from kb.core.config.profile.collecting import WikiSection
from kb.core.errors import ItemFinal, Retryable
from kb.crawl.connector import Answer
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier, Item
from kb.wiki import media_urls
from kb.wiki.capture import media_type
from kb.wiki.crawl import discover
from kb.wiki.crawl.client import BATCH, WikiApi
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.errors import NotAnImage
from kb.wiki.parse import answers

LONGEST = 5000  # bytes of titles in one URL; servers refuse longer ones


def batch_titles(items: list[Item]) -> list[Item]:
    """The first titles of one round that fit into one URL."""
    mine = list(takewhile(lambda item: tag(item) == tag(items[0]), items))
    return mine[: len(next(_parts([item.payload.title for item in mine])))]


def tag(item: Item) -> str:
    """The round of a title."""
    return item.key.partition(":")[0]


def _parts(names: Iterable[str]) -> Iterator[list[str]]:
    """Split titles, in order, into parts that fit into one URL."""
    part: list[str] = []
    size = 0
    for name in names:
        more = len(name.encode()) * 2
        if part and size + more > LONGEST:
            yield part
            part, size = [], 0
        part.append(name)
        size += more
    if part:
        yield part


def compare(api: WikiApi, frontier: Frontier, root: Path, round_: str) -> Iterator[Answer]:
    """End a round: ask about pages that disappeared and files that were replaced."""
    if round_.isdigit():
        ids = discover.unlisted(frontier, int(round_))
    else:
        ids = discover.unnamed(frontier, round_)
    for start in range(0, len(ids), BATCH):
        signals.stop.check()
        yield api.details(round_, ids=ids[start : start + BATCH])
    if round_.isdigit() and int(round_) > 1:
        yield from _replaced(api, frontier, root)
    discover.finish_round(frontier, root, round_)


def _replaced(api: WikiApi, frontier: Frontier, root: Path) -> Iterator[Answer]:
    """Ask about all fetched files and reopen those that changed."""
    stored_files: dict[str, dict[str, Any]] = {}
    for envelope in rawlog.read(root, "wiki", "files"):
        stored = envelope.response
        if stored["outcome"] == "stored" and stored.get("sha1") and stored.get("title"):
            stored_files[stored["key"]] = stored
    changed = []
    keys = sorted(stored_files)
    for start in range(0, len(keys), BATCH):
        signals.stop.check()
        part = [stored_files[key] for key in keys[start : start + BATCH]]
        answer = api.files(list(dict.fromkeys(stored["title"] for stored in part)))
        yield answer
        pages = _by_title(answer)
        for stored in part:
            info = (pages.get(stored["title"], {}).get("imageinfo") or [{}])[0]
            if info.get("sha1") not in (None, stored["sha1"]):
                changed.append(stored["key"])
    frontier.mark("files", changed, "todo")


def files(
    api: WikiApi, web: WikiHosts, section: WikiSection, threads: Executor, items: list[Item]
) -> Iterator[Answer]:
    """The original images, with their descriptions by the wiki."""
    known: dict[str, dict[str, Any]] = {}
    names = dict.fromkeys(item.payload.title for item in items if item.payload.title)
    for part in _parts(names):
        answer = api.files(part)
        yield answer
        known |= _by_title(answer)
    asked = [
        threads.submit(fetch_original, web, section, item, known.get(item.payload.title or "", {}))
        for item in items
    ]
    failed: BaseException | None = None
    for item, future in zip(items, asked, strict=True):
        try:
            stored = future.result()
        except BaseException as error:  # noqa: BLE001  record the other files first
            failed = failed or error
        else:
            yield Answer("files", item.key, {}, stored)
    if failed is not None:
        raise failed


def _by_title(answer: Answer) -> dict[str, dict[str, Any]]:
    """The wiki's descriptions of files, by requested title."""
    query = answer.response.get("query", {})
    names = answers.renamed(query)
    pages = {page.get("title"): page for page in query.get("pages", [])}
    asked = ((title, names.get(title, title)) for title in answer.params["titles"])
    return {title: pages[name] for title, name in asked if name in pages}


def fetch_original(
    web: WikiHosts, section: WikiSection, item: Item, page: dict[str, Any]
) -> dict[str, Any]:
    """Fetch one original image; returns the answer to be recorded.

    `page` is the wiki's description of the file, or empty. The file goes into raw/wiki/images under
    the name of its hash. Raises Blocked.
    """
    info = (page.get("imageinfo") or [{}])[0]
    answer: dict[str, Any] = {
        "key": item.key,
        "title": item.payload.title if info else None,
        "license": media_urls.file_licence(page),
        "description": info.get("descriptionurl"),
    }
    folder = Layout(web.run.root).images
    inspect = partial(media_type.inspect, max_pixels=section.max_pixels)
    reason, value, challenge = "", None, ""
    known = filter(None, (info.get("url"), item.key, item.payload.src))
    for url in dict.fromkeys(map(web.rebase_loopback, known)):
        if not web.allowed(url):
            reason, value = "robots", url
            continue
        try:
            sha256, image, size = web.attempt(
                partial(web.download, url, folder, section.max_file_bytes, inspect)
            )
        except NotAnImage as error:
            challenge = error.reason
            continue
        except ItemFinal as error:
            reason, value = reason or error.reason, value or error.value
            continue
        except Retryable as error:
            # One failing image does not stop the crawl: the next run retries it.
            return {**answer, "outcome": "failed", "reason": str(error)}
        return {
            **answer,
            "outcome": "stored",
            "sha1": info.get("sha1"),
            "url": url,
            "sha256": sha256,
            "bytes": size,
            "media_type": image.media_type,
            "path": str(BELOW.images / f"{sha256}.{image.extension}"),
            "width": image.width,
            "height": image.height,
            "frames": list(image.frames),
        }
    if challenge:
        return {**answer, "outcome": "failed", "reason": challenge}
    return {**answer, "outcome": "final", "reason": reason, "value": value}
