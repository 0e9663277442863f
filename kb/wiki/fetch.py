"""Phase 5: the original pictures, each once, named by what is in them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from kb.core import signals
from kb.core.errors import ItemFinal, Unreachable
from kb.store import rawlog
from kb.store.frontier import Item
from kb.wiki import addresses, pictures
from kb.wiki.api import BATCH, Api
from kb.wiki.job import Job


def fetch_files(job: Job, api: Api) -> None:
    """Fetch every picture that is to do. Raises Stopped."""
    frontier = job.frontier
    with (
        job.run.progress.task(
            "images", unit="files", waiting=lambda: frontier.waiting("files")
        ) as task,
        ThreadPoolExecutor(max(2, job.run.workers), thread_name_prefix="wiki-files") as threads,
    ):
        while items := frontier.take("files", BATCH):
            try:
                known = _ask(api, items)
                asked = [
                    (
                        item,
                        threads.submit(
                            _one, job, item, known.get(item.payload.get("title") or "", {})
                        ),
                    )
                    for item in items
                ]
                failed: BaseException | None = None
                for item, answer in asked:
                    try:
                        job.recorder.record("files", item.key, {}, 200, answer.result())
                        task.advance(1)
                    except BaseException as error:  # noqa: BLE001  the files in flight are kept first
                        failed = failed or error
                if failed is not None:
                    raise failed
            finally:
                left = [
                    item.key
                    for item in items
                    if (frontier.get("files", item.key) or ("",))[0] == "in_progress"
                ]
                frontier.release("files", *left)
            signals.stop.check()


def reopen_changed(job: Job, api: Api) -> int:
    """Ask for the files that were replaced on the wiki since they were fetched, 50 a call; how many are to fetch again."""
    held: dict[str, dict[str, Any]] = {}
    for envelope in rawlog.read(job.run.root, "wiki", "files"):
        answer = envelope.response
        if answer["outcome"] == "stored" and answer.get("sha1") and answer.get("title"):
            held[answer["key"]] = answer
    changed = []
    keys = sorted(held)
    for start in range(0, len(keys), BATCH):
        part = [held[key] for key in keys[start : start + BATCH]]
        pages = api.files(list(dict.fromkeys(answer["title"] for answer in part)))
        for answer in part:
            info = (pages.get(answer["title"], {}).get("imageinfo") or [{}])[0]
            if info.get("sha1") not in (None, answer["sha1"]):
                changed.append(answer["key"])
        signals.stop.check()
    job.frontier.mark("files", changed, "todo")
    return len(changed)


def _ask(api: Api, items: list[Item]) -> dict[str, dict[str, Any]]:
    """What the wiki knows about the files, by title; nothing for those that it does not hold."""
    titles = list(dict.fromkeys(title for item in items if (title := item.payload.get("title"))))
    found: dict[str, dict[str, Any]] = {}
    part: list[str] = []
    for title in [*titles, ""]:
        if part and (not title or sum(len(t.encode()) * 2 for t in [*part, title]) > 5000):
            found |= api.files(part)
            part = []
        part.append(title)
    return found


def _one(job: Job, item: Item, page: dict[str, Any]) -> dict[str, Any]:
    """One file: the answer to be recorded. Raises Stopped when the wiki can't be reached at all."""
    section, web = job.section, job.web
    info = (page.get("imageinfo") or [{}])[0]
    answer: dict[str, Any] = {
        "key": item.key,
        "title": item.payload.get("title") if info else None,
        "license": addresses.file_licence(page),
        "description": info.get("descriptionurl"),
    }
    folder = job.run.root / "raw" / "wiki" / "images"
    inspect = partial(pictures.inspect, max_pixels=section.max_pixels)
    reason, value = "", None
    known = filter(None, (info.get("url"), item.key, item.payload.get("src")))
    for url in dict.fromkeys(map(web.today, known)):
        if not web.allowed(url):
            reason, value = "robots", url
            continue
        try:
            sha256, found, size = web.attempt(
                partial(web.download, url, folder, section.max_file_bytes, inspect)
            )
        except ItemFinal as error:
            reason, value = reason or error.reason, value or error.value
            continue
        except Unreachable as error:
            # One picture that the server can't give is no reason to stop: the next run asks again.
            return {**answer, "outcome": "failed", "reason": str(error)}
        return {
            **answer,
            "outcome": "stored",
            "sha1": info.get("sha1"),
            "url": url,
            "sha256": sha256,
            "bytes": size,
            "media_type": found.media_type,
            "path": f"raw/wiki/images/{sha256}.{found.extension}",
            "width": found.width,
            "height": found.height,
            "frames": list(found.frames),
        }
    return {**answer, "outcome": "final", "reason": reason, "value": value}
