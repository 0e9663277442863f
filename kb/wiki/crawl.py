"""`kb wiki crawl`: list, ask, show, fetch. One round reads what is new since the last one.

1 list     the titles of all content pages            raw kind titles
2 ask      revision, address, contributors            raw kind pages
3 compare  vanished and moved pages become tombstones
4 show     each new revision in the browser           raw kind renders, raw/wiki/pages/
5 fetch    the original pictures                      raw kinds imageinfo, files, raw/wiki/images/
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kb.core import signals, vocabulary
from kb.core.context import Run
from kb.core.errors import KbError, LimitReached
from kb.core.progress import Task
from kb.core.verdict import Summary
from kb.store import belonging, tombstones
from kb.store.frontier import Frontier
from kb.store.identity import remember
from kb.store.lock import writer
from kb.store.recorder import Recorder
from kb.wiki import browser, capture, chromium, fetch, show, state
from kb.wiki.api import BATCH, Api, find_endpoint
from kb.wiki.job import Job
from kb.wiki.pool import Pool
from kb.wiki.titles import Titles, read_titles
from kb.wiki.web import Web


def crawl(run: Run, titles: Path | None = None) -> Summary:
    """Crawl the wiki of the profile. Raises UsageError before anything is sent, Stopped when it can go on later."""
    run.settings.need("kb_contact")
    section = run.profile.section("wiki")
    url = run.settings.kb_wiki_url or section.url
    wanted = read_titles(titles) if titles else None
    programs = chromium.find()
    with writer(run.root, "wiki"):
        belonging.note(run.root, run.profile)
        remember(run.root, "wiki", wiki=url)
        frontier = Frontier(run.root / "state" / "wiki.sqlite")
        try:
            with Recorder(run.root, "wiki", frontier, state.apply, asked=state.ASKED) as recorder:
                web = Web(run, url, section.hosts, section.seconds_between)
                job = Crawl(
                    run=run,
                    url=url,
                    section=section,
                    frontier=frontier,
                    recorder=recorder,
                    web=web,
                    programs=programs,
                    titles=wanted,
                )
                try:
                    job.go(wanted.names if wanted else None)
                except KbError as error:
                    error.summary = job.summary()  # type: ignore[attr-defined]
                    raise
                finally:
                    asked = frontier.cursor("requests", 0) + web.requests
                    frontier.set_cursor("requests", asked)
                return job.summary()
        finally:
            frontier.close()


@dataclass(kw_only=True)
class Crawl(Job):
    """The phases in their order."""

    programs: chromium.Programs
    titles: Titles | None
    missed_before: int = 0

    def go(self, wanted: list[str] | None) -> None:
        """All phases; each starts where an earlier run stopped."""
        self.missed_before = state.missing(self.frontier)
        number, tag = self._round(wanted)
        if not self._work_left(wanted):
            self.run.progress.say("the wiki crawl is finished; --again looks for what changed")
            return
        with Pool(self._browser, self.section.page_seconds + 15) as pool:
            self.web.read_robots()
            api = Api(self._endpoint(), self.web, self.recorder.record)
            self._discover(api, number, tag, wanted is None)
            left = show.show_pages(self, pool, api)
        fetch.fetch_files(self, api)
        if left:
            raise LimitReached(
                f"--limit {self.run.limit} reached, {left} pages left",
                hint="run the same command to go on",
            )

    # -- rounds ----------------------------------------------------------------------------------

    def _round(self, wanted: list[str] | None) -> tuple[int, str]:
        """Number and tag of the round to work on; --again starts a new one when the last is complete.

        A round of named titles has number 0: it says nothing about what the wiki lists.
        """
        name = "round" if wanted is None else "named"
        held = self.frontier.cursor(name) or {"number": 1, "done": False}
        if self.run.again and held["done"]:
            held = {"number": held["number"] + 1, "done": False}
        self.frontier.set_cursor(name, held)
        number = int(held["number"]) if wanted is None else 0
        tag = str(number) if wanted is None else f"t{held['number']}"
        if wanted is not None:
            self.frontier.add("info", [(f"{tag}:{title}", {"title": title}) for title in wanted])
        # What failed in an earlier run is tried again, once a run.
        for kind in ("info", "pages", "files"):
            self.frontier.reopen(kind, "error")
        state.reopen_larger(self.frontier, self.section)
        state.reopen_moved(self.frontier, self.web.today)
        return number, tag

    def _work_left(self, wanted: list[str] | None) -> bool:
        listed = wanted is not None or (self.frontier.cursor("round") or {}).get("done")
        return not listed or any(
            self.frontier.counts(kind).get("todo") for kind in ("info", "pages", "files")
        )

    def _endpoint(self) -> str:
        known = self.frontier.cursor("endpoint")
        if known and known[0] == self.url and not self.run.again:
            found = known[1]
        else:
            found = find_endpoint(self.web, self.url)
            self.frontier.set_cursor("endpoint", [self.url, found])
        self.web.barred(found)
        return found

    # -- discovery -------------------------------------------------------------------------------

    def _discover(self, api: Api, number: int, tag: str, listing: bool) -> None:
        complete = (self.frontier.cursor("round") or {}).get("done")
        if not self.frontier.cursor(f"site:{tag}"):
            site = api.site()
            content = [
                int(key)
                for key, space in site.get("namespaces", {}).items()
                if space.get("content")
            ]
            self.frontier.set_cursor(
                f"site:{tag}", {"namespaces": sorted(self.section.namespaces or content or [0])}
            )
        if listing and not complete:
            self._list(api, number, tag)
        self._ask(api)
        if listing and not complete:
            self._compare(api, number)
            if number > 1:
                fetch.reopen_changed(self, api)
            self.frontier.set_cursor("round", {"number": number, "done": True})
        elif not listing:
            self._ask_after(api, tag)
            self.frontier.set_cursor("named", {"number": int(tag[1:]), "done": True})
        self._bury()

    def _list(self, api: Api, number: int, tag: str) -> None:
        with self.run.progress.task("titles", unit="titles") as task:
            for namespace in self.frontier.cursor(f"site:{tag}")["namespaces"]:
                start = self.frontier.cursor(f"list:{number}:{namespace}", {})
                if start == "done":
                    continue
                for count in api.listing(number, namespace, start):
                    task.advance(count)
                    signals.stop.check()

    def _ask(self, api: Api) -> None:
        with self.run.progress.task(
            "revisions", unit="titles", waiting=lambda: self.frontier.waiting("info")
        ) as task:
            self._ask_all(api, task)

    def _ask_all(self, api: Api, task: Task) -> None:
        while items := self.frontier.take("info", BATCH):
            tag = items[0].key.partition(":")[0]
            # One round a call; and long titles would make an address that servers refuse.
            while len(items) > 1 and (
                items[-1].key.partition(":")[0] != tag
                or sum(len(item.payload["title"].encode()) * 2 for item in items) > 5000
            ):
                self.frontier.release("info", items.pop().key)
            api.details(tag, titles=[item.payload["title"] for item in items])
            for item in items:
                if (self.frontier.get("info", item.key) or ("",))[0] == "in_progress":
                    self.frontier.error("info", item.key, "unanswered")
            task.advance(len(items))
            signals.stop.check()

    def _compare(self, api: Api, number: int) -> None:
        """Ask after the pages that the list no longer has: deleted, moved away, or made a redirect."""
        gone = [
            key
            for key, status, reason, payload in self.frontier.items("pages")
            if payload["round"] < number
            and not (status == "skipped" and reason in ("deleted", "moved"))
        ]
        for start in range(0, len(gone), BATCH):
            api.details(str(number), ids=gone[start : start + BATCH])
            signals.stop.check()

    def _ask_after(self, api: Api, tag: str) -> None:
        """Ask by their ids after known pages whose titles, named again, have no page any more: deleted or moved away."""
        titles = {
            payload["title"]
            for key, _, _, payload in self.frontier.items("info", "skipped")
            if key.startswith(f"{tag}:")
        }
        titles |= {title[:1].upper() + title[1:] for title in titles}  # as most wikis write them
        left = [
            key
            for key, status, _, payload in self.frontier.items("pages")
            if payload["title"] in titles and status in ("done", "todo", "error")
        ]
        for start in range(0, len(left), BATCH):
            api.details(tag, ids=left[start : start + BATCH])
            signals.stop.check()

    def _bury(self) -> None:
        """Tombstones for what vanished: a page by its id, a title that a page left by that title.

        A page that this crawl saw go is taken back when the wiki shows it again. One that was purged
        meanwhile is not: the frontier has forgotten it, so to the crawl it is a new page with a tombstone.
        """
        rows: list[tuple[str, str]] = []
        back: list[str] = []
        titles = set()
        for key, status, reason, payload in self.frontier.items("pages"):
            if status == "skipped" and reason in ("deleted", "moved"):
                rows.append((key, reason))
            else:
                back += [key] if payload.get("gone") else []
                titles.add(payload["title"])
            rows += [(title, "moved") for title in payload.get("former", [])]
        tombstones.lift(self.run.root, "wiki", {*back, *titles}, ("deleted", "moved"))
        rows = [row for row in rows if row[0] not in titles]
        if rows:
            tombstones.add(self.run.root, "wiki", rows)

    # -- the browser -----------------------------------------------------------------------------

    def _browser(self, watcher: Any) -> browser.Browser:
        section = self.section
        hosts, origins = browser.reach(self.url, section.hosts)
        return browser.Browser(
            self.programs,
            watcher,
            hosts=hosts,
            origins=origins,
            user_agent=self.web.agent,
            viewport=(section.viewport_width, section.viewport_height),
            page_seconds=section.page_seconds,
            before=capture.page_script("settle.js"),
        )

    def summary(self) -> Summary:
        """What this run crawled and asked, and how the whole data root stands.

        `crawled` are this run's answers, as the filter counts them: pages that were captured, are
        barred or can't be shown (`rejected`: too large, an error page), and titles without a page
        (`missing`). `failed` pages and titles are tried again by the next run; `gone` ones left.
        """
        kinds = self.frontier.kinds()
        pages, files, info = (kinds.get(kind, {}) for kind in ("pages", "files", "info"))
        skipped = Counter(reason for _, _, reason, _ in self.frontier.items("pages", "skipped"))
        robots, gone = (
            skipped.pop("disallowed", 0),
            sum(skipped.pop(reason, 0) for reason in ("deleted", "moved", "removed")),
        )
        missing = state.missing(self.frontier)
        crawled = self.answered + max(0, missing - self.missed_before)
        in_all = state.crawled(self.frontier)
        left = vocabulary.left_by("wiki", kinds)
        return Summary(
            command="wiki crawl",
            source="wiki",
            counted="pages",
            crawled=crawled,
            crawled_in_all=in_all,
            missing=missing,
            rejected=skipped.total(),
            robots=robots,
            failed=pages.get("error", 0) + info.get("error", 0),
            pending=self.frontier.waiting("pages"),
            gone=gone,
            **({"bad_lines": self.titles.bad_lines} if self.titles else {}),
            images=files.get("done", 0),
            images_failed=files.get("error", 0) + files.get("skipped", 0),
            requests=self.web.requests,
            left=sum(left.values()),
            left_by=left,
        )
