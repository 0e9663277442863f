"""Captures one page in at most `max_tries` tries and stores its files."""

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock
from kb.core.config.profile.wiki import Wiki
from kb.core.errors import Blocked, ItemFinal, Retryable
from kb.net import retry
from kb.store.atomic import full_disk_is_resumable, replacing_folder
from kb.store.layout import Layout
from kb.store.rawlog import rawlog, sidefiles
from kb.store.state.frontier import Item
from kb.wiki import media_urls
from kb.wiki.browser.pool import Pool
from kb.wiki.capture.page import Captured, capture, check_page
from kb.wiki.capture.screenshot import pixel_box
from kb.wiki.connector.http_client import WikiHosts
from kb.wiki.errors import Challenge, NotNow, NotShown, PageRefused

SCRATCH = ".shot-"
_ENCODER = msgspec.json.Encoder()


def render_page(
    web: WikiHosts, section: Wiki, pool: Pool, item: Item, others: Callable[[], Iterable[str]]
) -> dict[str, Any]:
    """All tries of one page: the answer to be recorded. `others` are addresses of pages to compare
    it with when it is challenged. Raises Retryable, Stopped, MissingExtra.
    """
    url = web.today(item.payload.url)
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
        full_disk_is_resumable(root),
        tempfile.TemporaryDirectory(prefix=SCRATCH, dir=pages_folder(root)) as scratch,
    ):
        shot = Path(scratch) / "screenshot.png"
        for number in range(1, section.max_tries + 1):
            last = number == section.max_tries
            try:
                captured = _capture(web, section, pool, item, url, shot, strict=not last)
                stored = _store(root, item, captured, shot)
                return {**answer, "tries": number, **stored}
            except ItemFinal as error:
                return {**answer, **_final(web, error), "tries": number}
            except Retryable as error:
                reason, _, value = error.reason.partition(": ")
                web.rest(error.after)
                if error.unreachable or isinstance(error, NotShown):
                    final = _request_plainly(web, url, error)
                    if final is not None:
                        return {**answer, **_final(web, final), "tries": number}
                elif not last:
                    clock.sleep(0.1 * number)
                elif isinstance(error, Challenge):
                    _compare_with_others(web, pool, others())
    failed = {"outcome": "failed", "reason": reason, "value": value or None}
    return {**answer, **failed, "tries": section.max_tries}


def _capture(
    web: WikiHosts, section: Wiki, pool: Pool, item: Item, url: str, shot: Path, *, strict: bool
) -> Captured:
    """One try. Raises ItemFinal, Retryable."""
    return pool.use(
        lambda browser: capture(
            browser,
            url,
            shot,
            section.rules,
            max_height=section.max_page_height,
            page_id=int(item.key),
            strict=strict,
            turn=web.turn,
        ),
        first=web.pace.wait,
    )


def _final(web: WikiHosts, error: ItemFinal) -> dict[str, Any]:
    """What an answer that makes further tries useless means for the page. Raises Blocked.

    Answers about one request rather than about the page are asked for again by the next run.
    """
    if isinstance(error, PageRefused):
        _check_front_page(web)
    outcome = "failed" if isinstance(error, (PageRefused, NotNow)) else "final"
    return {"outcome": outcome, "reason": error.reason, "value": error.value}


def _check_front_page(web: WikiHosts) -> None:
    """A refused page may be that page's own matter; a refused front page is not. Raises Blocked."""
    try:
        web.attempt(lambda: web.get(f"{web.root}/", {}), service="the wiki")
    except ItemFinal as error:
        raise Blocked(
            f"the wiki blocks requests ({error.reason})", hint="wait and run the same command again"
        ) from None


def _compare_with_others(web: WikiHosts, pool: Pool, others: Iterable[str]) -> None:
    """A challenge instead of one page may be about that page; instead of others, too, it is about
    us. They are loaded in the browser, as challenges tell browsers from plain clients, until one
    is shown. Raises Blocked.
    """
    challenged = False
    for url in others:
        show = partial(check_page, url=web.today(url))
        try:
            pool.use(show, first=web.pace.wait)
        except (Challenge, PageRefused):
            challenged = True
        except (ItemFinal, Retryable):
            continue  # it says nothing about challenges
        else:
            return
    if challenged:
        raise retry.blocked("the wiki answers with a challenge instead of its pages")


def _request_plainly(web: WikiHosts, url: str, error: Retryable) -> ItemFinal | None:
    """A plain request tells what the browser hides: 4xx without a body, no wiki at all.

    When the browser was told a time to come back, nothing is asked before. The answer that makes
    further tries useless, if it is one. Raises Retryable, Blocked.
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
    """Where captured pages are; it is made when it is not there."""
    folder = Layout(root).captures
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def remove_scratch(root: Path) -> None:
    """Remove what a run that was killed left half-shown."""
    for left in pages_folder(root).glob(f"{SCRATCH}*"):
        shutil.rmtree(left, ignore_errors=True)


def _store(root: Path, item: Item, captured: Captured, shot: Path) -> dict[str, Any]:
    """Write the page's files in one step; what the envelope says about them."""
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
    files = wanted_files(captured.extraction)
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
        "files": files,
    }


def wanted_files(extraction: dict[str, Any]) -> list[dict[str, Any]]:
    """The original files that a page shows, each once, in order: key (address), title, source."""
    files: dict[str, dict[str, Any]] = {}
    page = media_urls.original(extraction["page"]["url"])
    for element in extraction["elements"]:
        for image in element.get("frames") or [element]:
            src = image.get("src")
            if src and src.startswith(("http:", "https:")):
                key = media_urls.original(src)
                # An address that is the page's own, as of src="#", is no image.
                if key != page and key not in files:
                    files[key] = {
                        "key": key,
                        "title": media_urls.file_title(src, image.get("file")),
                        "src": src,
                    }
    return list(files.values())
