"""Fetches each kind of item from the wiki, as answers to be recorded. A page is captured in at most
`max_tries` tries.
"""

import base64
import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote_to_bytes

import msgspec

from kb.core import clock, signals
from kb.core.errors import ItemFinal, Postponed, Retryable
from kb.crawl.connector import Answer
from kb.store.atomic import replacing_folder
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog, sidefiles
from kb.store.state.frontier import Frontier, Item
from kb.wiki import media_urls
from kb.wiki.browser.browser import Pool
from kb.wiki.capture import media_type
from kb.wiki.capture.page import Captured, capture
from kb.wiki.capture.screenshot import pixel_box
from kb.wiki.crawl import discover
from kb.wiki.crawl.client import BATCH, WikiApi
from kb.wiki.crawl.discover import Comparison
from kb.wiki.crawl.front_end import FrontEnd, file_probes, page_probes
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.errors import (
    BrowserError,
    Challenge,
    HttpStatus,
    NotAnImage,
    OtherPage,
    PageMoved,
    PageRefused,
    TransientStatus,
)
from kb.wiki.parse import answers
from kb.wiki.section import WikiSection

LARGEST_PART = 1_000_000  # characters of a picture in a data: address
LONGEST = 5000  # bytes of titles in one URL; servers refuse longer ones
_PATIENCE = 4  # of a page that moved, when it is tried alone
_UNDECIDED = (NotAnImage, PageRefused, TransientStatus)  # the next run asks again


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
        signals.stop.raise_if_asked()
        yield api.details(round_, ids=ids[start : start + BATCH])
    if round_.isdigit() and int(round_) > 1:
        yield from _replaced(api, frontier, root)
    discover.finish_round(frontier, root, round_)


def _replaced(api: WikiApi, frontier: Frontier, root: Path) -> Iterator[Answer]:
    """Ask about all fetched files and reopen those that changed."""
    stored_files: dict[str, dict[str, Any]] = {}
    for envelope in rawlog.envelopes(root, "wiki", "files"):
        stored = envelope.response
        if stored["outcome"] == "stored" and stored.get("sha1") and stored.get("title"):
            stored_files[stored["key"]] = stored
    changed = []
    keys = sorted(stored_files)
    for start in range(0, len(keys), BATCH):
        signals.stop.raise_if_asked()
        part = [stored_files[key] for key in keys[start : start + BATCH]]
        answer = api.files(list(dict.fromkeys(stored["title"] for stored in part)))
        yield answer
        pages = _by_title(answer)
        for stored in part:
            info = (pages.get(stored["title"], {}).get("imageinfo") or [{}])[0]
            if info.get("sha1") not in (None, stored["sha1"]):
                changed.append(stored["key"])
    frontier.mark("files", changed, "todo")


class FileAnswer(NamedTuple):
    """The answer to record of one file. Where a URL was refused, others are compared first."""

    answer: dict[str, Any]
    refused_url: str = ""
    refused_for: str = ""


def files(
    api: WikiApi,
    web: WikiHosts,
    section: WikiSection,
    threads: Executor,
    items: list[Item],
    front: FrontEnd,
    others: Callable[[str, list[str]], list[Comparison]],
) -> Iterator[Answer]:
    """The original images, with their descriptions by the wiki. `others` gives the files to compare
    a refused one with, by its URL and those that were served just now.
    """
    known: dict[str, dict[str, Any]] = {}
    names = dict.fromkeys(item.payload.title for item in items if item.payload.title)
    for part in _parts(names):
        answer = api.files(part)
        yield answer
        known |= _by_title(answer)
    asked = [
        threads.submit(
            fetch_original, web, section, item, known.get(item.payload.title or "", {}), front
        )
        for item in items
    ]
    failed: BaseException | None = None
    served: list[str] = []
    refused = []
    for item, future in zip(items, asked, strict=True):
        try:
            file = future.result()
        except BaseException as error:  # noqa: BLE001  record the other files first
            failed = failed or error
            continue
        if file.refused_url:
            refused.append((item, file))
            continue
        if file.answer["outcome"] == "stored" and "url" in file.answer:
            served.append(file.answer["url"])
        yield Answer("files", item.key, {}, file.answer)
    if failed is not None:
        raise failed
    # Only now is it known which files of this batch were served.
    for item, file in refused:
        front.compare(file.refused_for, file_probes(web, others(file.refused_url, served)))
        yield Answer("files", item.key, {}, file.answer)


def _by_title(answer: Answer) -> dict[str, dict[str, Any]]:
    """The wiki's descriptions of files, by requested title."""
    query = answer.response.get("query", {})
    names = answers.renamed(query)
    pages = {page.get("title"): page for page in query.get("pages", [])}
    asked = ((title, names.get(title, title)) for title in answer.params["titles"])
    return {title: pages[name] for title, name in asked if name in pages}


def fetch_original(
    web: WikiHosts,
    section: WikiSection,
    item: Item,
    page: dict[str, Any],
    front: FrontEnd,
) -> FileAnswer:
    """Fetch one original image.

    `page` is the wiki's description of the file, or empty. The file goes into raw/wiki/images under
    the name of its hash. Raises Blocked, Challenged.
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
    reason, value, undecided, refused = "", None, "", ""
    known = filter(None, (info.get("url"), *media_urls.sources(item.key, item.payload.src)))
    for url in dict.fromkeys(map(web.rebase_loopback, known)):
        front.raise_challenged()
        if not web.allowed(url):
            reason, value = "robots", url
            continue
        try:
            sha256, image, size = web.attempt(
                partial(web.download, url, folder, section.max_file_bytes, inspect)
            )
        except ItemFinal as error:
            if isinstance(error, (HttpStatus, NotAnImage)):
                refused = refused or url
            if isinstance(error, _UNDECIDED):
                undecided = undecided or error.reason
            else:
                reason, value = reason or error.reason, value or error.value
            continue
        except Retryable as error:
            # One failing image does not stop the crawl: the next run retries it.
            return FileAnswer({**answer, "outcome": "failed", "reason": str(error)})
        stored = _stored(sha256, image, size)
        return FileAnswer({**answer, **stored, "sha1": info.get("sha1"), "url": url})
    if undecided:
        answer |= {"outcome": "failed", "reason": undecided}
    elif (item.payload.src or "").startswith("data:"):
        answer |= _part_of_page(folder, item.payload.src, inspect)
    elif reason:
        answer |= {"outcome": "final", "reason": reason, "value": value}
    else:  # a thumbnail of a file without a name
        answer |= {"outcome": "final", "reason": "no_original", "value": item.payload.src}
    return FileAnswer(answer, refused, undecided or reason)


SCRATCH = ".shot-"
_ENCODER = msgspec.json.Encoder()


def _stored(sha256: str, image: media_type.ImageFile, size: int) -> dict[str, Any]:
    return {
        "outcome": "stored",
        "sha256": sha256,
        "bytes": size,
        "media_type": image.media_type,
        "path": str(BELOW.images / f"{sha256}.{image.extension}"),
        "width": image.width,
        "height": image.height,
        "frames": list(image.frames),
    }


def _part_of_page(folder: Path, src: str, inspect: Callable[[bytes], Any]) -> dict[str, Any]:
    """Store a picture that stands in the page's own text, in a `data:` address."""
    head, _, text = src.partition(",")
    try:
        data = unquote_to_bytes(text)
        data = base64.b64decode(data) if head.endswith(";base64") else data
        image = inspect(data)
    except ValueError:
        image = None
    if image is None:
        return {"outcome": "final", "reason": "not_a_picture", "value": None}
    sha256 = hashlib.sha256(data).hexdigest()
    sidefiles.write_named(folder / f"{sha256}.{image.extension}", data)
    return _stored(sha256, image, len(data))


def render_page(
    web: WikiHosts,
    section: WikiSection,
    pool: Pool,
    item: Item,
    others: Callable[[], Iterable[Comparison]],
    file_names: Sequence[str] = ("File", "Image"),
    *,
    front: FrontEnd,
    alone: bool = False,
) -> dict[str, Any]:
    """All tries of one page; returns the answer to record. `others` are pages to compare with when
    this one is refused. A page that moves while it is captured is postponed, and then shown
    `alone`: once more, with no other page beside it, and more time.

    Raises Retryable, Postponed, Stopped, MissingExtra.
    """
    url = web.rebase_loopback(item.payload.url)
    answer: dict[str, Any] = {
        "page_id": int(item.key),
        "title": item.payload.title,
        "url": url,
        "wanted_revision": item.payload.revision_id,
    }
    if not web.allowed(url):
        return {**answer, "outcome": "robots", "reason": "disallowed", "value": None}
    root = web.run.root
    with (
        front.page(),
        full_disk_is_resumable(root),
        tempfile.TemporaryDirectory(prefix=SCRATCH, dir=pages_folder(root)) as scratch,
    ):
        shot = Path(scratch) / "screenshot.png"
        most = section.max_tries
        for number in (most + 1,) if alone else range(1, most + 1):
            last = number >= most
            try:
                show = partial(
                    capture,
                    url=url,
                    shot=shot,
                    rules=section.rules,
                    max_height=section.max_page_height,
                    page_id=int(item.key),
                    strict=alone or not last,
                    patience=_PATIENCE if alone else 1,
                    turn=web.turn,
                )
                captured = pool.use(show, first=web.pace.wait, alone=alone)
                front.shown()
                stored = _store(root, item, captured, shot, file_names)
                return {**answer, "tries": number, **stored}
            except ItemFinal as error:
                return {**answer, **_final(web, pool, error, front, others), "tries": number}
            except Retryable as error:
                reason, _, value = error.reason.partition(": ")
                web.rest(error.after)
                if error.unreachable or isinstance(error, BrowserError):
                    final = _request_plainly(web, url, error)
                    if final is not None:
                        verdict = _final(web, pool, final, front, others)
                        return {**answer, **verdict, "tries": number}
                elif not last:
                    clock.sleep(0.1 * number)
                elif isinstance(error, Challenge):
                    front.compare(error.reason, page_probes(web, pool, others()))
                elif isinstance(error, PageMoved) and not alone:
                    raise Postponed(error.reason) from None
    failed = {"outcome": "failed", "reason": reason, "value": value or None}
    return {**answer, **failed, "tries": number}


def _final(
    web: WikiHosts,
    pool: Pool,
    error: ItemFinal,
    front: FrontEnd,
    others: Callable[[], Iterable[Comparison]],
) -> dict[str, Any]:
    """The outcome of an error that no retry can change. Raises Challenged where other pages are not
    shown either.
    """
    if isinstance(error, (HttpStatus, OtherPage)) and not isinstance(error, TransientStatus):
        front.compare(error.reason, page_probes(web, pool, others()))
    outcome = "failed" if isinstance(error, _UNDECIDED) else "final"
    return {"outcome": outcome, "reason": error.reason, "value": error.value}


def _request_plainly(web: WikiHosts, url: str, error: Retryable) -> ItemFinal | None:
    """Find out by a plain request what the browser hides: 4xx without a body, an unreachable wiki.

    Waits for a Retry-After that the browser received. Returns the error if no retry can change it.
    Raises Retryable, Blocked.
    """
    announced = [error] if error.after is not None else []

    def ask() -> None:
        if announced:
            raise announced.pop()
        web.get(url, {})

    try:
        web.attempt(ask)
    except ItemFinal as final:
        return final
    return None


def pages_folder(root: Path) -> Path:
    """The folder of captured pages; created if missing."""
    folder = Layout(root).captures
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def remove_scratch(root: Path) -> None:
    """Remove incomplete captures of killed runs."""
    for left in pages_folder(root).glob(f"{SCRATCH}*"):
        shutil.rmtree(left, ignore_errors=True)


def _store(
    root: Path, item: Item, captured: Captured, shot: Path, file_names: Sequence[str]
) -> dict[str, Any]:
    """Write the page's files in one step; returns their part of the answer."""
    page = captured.extraction["page"]
    revision = int(page["revision_id"])
    folder = pages_folder(root) / str(int(item.key)) / str(revision)
    images = Layout(root).images
    sprites = {}
    for element, data in sorted(captured.sprites.items()):
        name = hashlib.sha256(data).hexdigest()
        sprites[str(element)] = name
        left, top, right, bottom = pixel_box(captured.extraction["elements"][element]["box"])
        captured.extraction["elements"][element]["crop"] = [right - left, bottom - top]
        sidefiles.write_named(images / f"{name}.png", data)
    files = wanted_files(captured.extraction, file_names)
    # Several sessions may show one page again: a folder is replaced as a whole or not at all.
    pack = rawlog.compressor()
    with replacing_folder(folder) as fresh:
        shutil.move(shot, fresh / "screenshot.png")
        (fresh / "page.html.zst").write_bytes(
            pack.compress(captured.html.encode("utf-8", "replace"))
        )
        (fresh / "extraction.json.zst").write_bytes(
            pack.compress(_ENCODER.encode({**captured.extraction, "sprites": sprites}))
        )
        sidefiles.write_sums(fresh)
    return {
        "outcome": "captured",
        "revision_id": revision,
        "folder": str(folder.relative_to(root)),
        "settled": captured.settled,
        "elements": len(captured.extraction["elements"]),
        "unread_facts": page["unread_facts"],
        "files": files,
    }


def wanted_files(
    extraction: dict[str, Any], file_names: Sequence[str] = ("File", "Image")
) -> list[dict[str, Any]]:
    """The original image files of a page, each once, in order: key (`media_urls.file_key`), title,
    source.
    """
    files: dict[str, dict[str, Any]] = {}
    for element in extraction["elements"]:
        for image in element.get("frames") or [element]:
            key = media_urls.file_key(image)
            if key and key not in files:
                src = image["src"]
                title = media_urls.file_title(src, image.get("file"), file_names)
                files[key] = {
                    "key": key,
                    "title": None if image.get("poster") else title,
                    "src": src if len(src) <= LARGEST_PART else None,
                }
    return list(files.values())
