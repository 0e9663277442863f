"""Phase 4: pages in the browser, several at once, each at most three times."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.core import clock, signals
from kb.core.errors import Blocked, ItemFinal, Retryable
from kb.store import tombstones
from kb.store.atomic import full_disk_is_resumable, replacing_folder, write_bytes
from kb.store.frontier import Item
from kb.wiki import addresses
from kb.wiki.api import Api
from kb.wiki.capture import Captured, capture
from kb.wiki.job import Job
from kb.wiki.pool import Pool
from kb.wiki.screenshot import snapped

SCRATCH = ".shot-"
# Answers about one request rather than about the page: asked again by the next run.
_OURS = ("http_401", "http_403", "http_408", "http_425")
_ENCODER = msgspec.json.Encoder()


def show_pages(job: Job, pool: Pool, api: Api) -> int:
    """Show every page that is to do, at most --limit of them; how many are left. Raises Stopped."""
    frontier, run = job.frontier, job.run
    barred = tombstones.keys(run.root, "wiki")
    for left in _pages_folder(job).glob(f"{SCRATCH}*"):  # of a run that was killed
        shutil.rmtree(left, ignore_errors=True)
    started = 0
    stop: BaseException | None = None
    with (
        run.progress.task(
            "pages", run.limit, "pages", waiting=lambda: frontier.waiting("pages")
        ) as task,
        ThreadPoolExecutor(run.workers, thread_name_prefix="wiki") as threads,
    ):
        flying: dict[Future[dict[str, Any]], Item] = {}
        while True:
            while (
                stop is None
                and len(flying) < run.workers
                and (run.limit is None or started < run.limit)
                and not signals.stop.requested()
                and (items := frontier.take("pages", 1))
            ):
                item = items[0]
                if item.key in barred or item.payload["title"] in barred:
                    frontier.skip("pages", item.key, "removed")
                    continue
                started += 1
                flying[threads.submit(_page, job, pool, item)] = item
            if not flying:
                break
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                item = flying.pop(future)
                try:
                    answer = future.result()
                    _keep(job, api, item, answer)
                    job.answered += answer["outcome"] != "failed"
                    task.advance(1)
                except BaseException as error:  # noqa: BLE001  the pages in flight are kept first
                    frontier.release("pages", item.key)
                    stop = stop or error
        if stop is not None:
            raise stop
        signals.stop.check()
    return frontier.counts("pages").get("todo", 0)


def _page(job: Job, pool: Pool, item: Item) -> dict[str, Any]:
    """All tries of one page: the answer to be recorded. Raises Stopped, MissingExtra."""
    section, url = job.section, job.web.today(item.payload["url"])
    answer: dict[str, Any] = {
        "page_id": int(item.key),
        "title": item.payload["title"],
        "url": url,
        "wanted_revision": item.payload["revision_id"],
    }
    if not job.web.allowed(url):
        return {**answer, "outcome": "robots", "reason": "disallowed", "value": None}
    reason, value, final = "", None, False
    with (
        full_disk_is_resumable(job.run.root),
        tempfile.TemporaryDirectory(prefix=SCRATCH, dir=_pages_folder(job)) as scratch,
    ):
        picture = Path(scratch) / "screenshot.png"
        for number in range(1, section.max_tries + 1):
            try:
                found = pool.use(
                    lambda browser, last=number == section.max_tries: capture(
                        browser,
                        url,
                        picture,
                        section.rules,
                        max_height=section.max_page_height,
                        strict=not last,
                        turn=job.web.turn,
                    ),
                    first=job.web.pace.wait,
                )
                shown = found.extraction["page"]["page_id"]
                if shown and shown != int(item.key):
                    raise ItemFinal("other_page", str(shown))
                return {**answer, "tries": number, **_store(job, item, found, picture)}
            except ItemFinal as error:
                reason, value, final = error.reason, error.value, True
                break
            except Retryable as error:
                reason, _, said = error.reason.partition(": ")
                value = said or None
                job.web.rest(error.after)
                if error.unreachable or reason.startswith(("err_", "not_loaded")):
                    if said_plainly := _ask_plainly(job, url, error):
                        reason, value, final = said_plainly.reason, said_plainly.value, True
                        break
                elif number < section.max_tries:
                    clock.sleep(0.1 * number)
    if reason in ("http_401", "http_403"):
        _blocked(job)
    outcome = "final" if final and reason not in _OURS else "failed"
    return {**answer, "outcome": outcome, "reason": reason, "value": value, "tries": number}


def _blocked(job: Job) -> None:
    """A refused page may be that page's own matter; a refused front page is not. Raises Blocked."""
    try:
        job.web.attempt(lambda: job.web.get(f"{job.url}/", {}))
    except ItemFinal as error:
        raise Blocked(
            f"the wiki refuses us ({error.reason})", hint="wait and run the same command again"
        ) from None


def _ask_plainly(job: Job, url: str, error: Retryable) -> ItemFinal | None:
    """A plain request tells what the browser hides: 4xx without a body, no wiki at all.

    When the browser was told a time to come back, nothing is asked before. The answer that makes
    further tries useless, if it is one. Raises Unreachable, Blocked.
    """
    told = [error] if error.after is not None else []

    def ask() -> None:
        if told:
            raise told.pop()
        job.web.get(url, {})

    try:
        job.web.attempt(ask)
    except ItemFinal as final:
        return final
    return None


def _pages_folder(job: Job) -> Path:
    folder = job.run.root / "raw" / "wiki" / "pages"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _store(job: Job, item: Item, found: Captured, picture: Path) -> dict[str, Any]:
    """Write the page's files in one step; what the envelope says about them."""
    watch = clock.monotonic()
    page = found.extraction["page"]
    revision = int(page["revision_id"] or item.payload["revision_id"])
    folder = _pages_folder(job) / str(int(item.key)) / str(revision)
    images = job.run.root / "raw" / "wiki" / "images"
    sprites = {}
    for element, data in sorted(found.sprites.items()):
        name = _sha256(data)
        sprites[str(element)] = name
        left, top, right, bottom = snapped(found.extraction["elements"][element]["box"])
        found.extraction["elements"][element]["crop"] = [right - left, bottom - top]
        if not (images / f"{name}.png").exists():
            write_bytes(images / f"{name}.png", data)
    files = wanted_files(found.extraction)
    # Several sessions may show one page again: a folder is replaced as a whole or not at all.
    pack = zstandard.ZstdCompressor(level=3)
    with replacing_folder(folder) as fresh:
        shutil.move(picture, fresh / "screenshot.png")
        (fresh / "page.html.zst").write_bytes(pack.compress(found.html.encode("utf-8", "replace")))
        (fresh / "extraction.json.zst").write_bytes(
            pack.compress(_ENCODER.encode({**found.extraction, "sprites": sprites}))
        )
    seconds = {**found.seconds, "store": round(clock.monotonic() - watch, 4)}
    return {
        "outcome": "captured",
        "revision_id": revision,
        "folder": str(folder.relative_to(job.run.root)),
        "settled": found.settled,
        "elements": len(found.extraction["elements"]),
        "files": files,
        "seconds": seconds,
    }


def _sha256(data: bytes) -> str:

    return hashlib.sha256(data).hexdigest()


def wanted_files(extraction: dict[str, Any]) -> list[dict[str, Any]]:
    """The original files that a page shows, each once, in order: key (address) and title on the wiki."""
    found: dict[str, dict[str, Any]] = {}
    page = addresses.original(extraction["page"]["url"])
    for element in extraction["elements"]:
        for held in element.get("frames") or [element]:
            src = held.get("src")
            if src and src.startswith(("http:", "https:")):
                key = addresses.original(src)
                # An address that is the page's own, as of src="#", is no image.
                if key != page and key not in found:
                    found[key] = {
                        "key": key,
                        "title": addresses.file_title(src, held.get("file")),
                        "src": src,
                    }
    return list(found.values())


def _keep(job: Job, api: Api, item: Item, answer: dict[str, Any]) -> None:
    """Record the answer; ask for the revision's facts when the wiki showed another than it had named."""
    revision = answer.get("revision_id")
    if revision and revision != item.payload["revision_id"]:
        api.revision(revision)
    job.recorder.record(
        "renders",
        answer["url"],
        {"page_id": item.key},
        200 if answer["outcome"] == "captured" else 0,
        answer,
    )
