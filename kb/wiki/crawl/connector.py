"""The wiki as a source of the crawl frame. Each round reads what is new.

site     the wiki's description of itself     raw kind site
titles   the titles of all content pages      raw kind titles
info     revision, address, contributors      raw kind pages
gone     tombstones for pages that disappeared     raw kinds pages, imageinfo
pages    each new revision in the browser     raw kind renders, raw/wiki/pages/
files    the original images                raw kinds imageinfo, files, raw/wiki/images/
"""

import math
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from requests import PreparedRequest

from kb.core.config.addresses import is_loopback
from kb.core.context import Run
from kb.core.errors import Postponed
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.core.summary.plan import NOTHING_NEW, PlanPhase, plan, to_read
from kb.crawl.connector import Answer, Connector, Opened, Phase, seed_requests
from kb.crawl.id_list import IdList
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.quota import Quota
from kb.crawl.session import CrawlSession
from kb.net.retry import Note
from kb.store.layout import Layout
from kb.store.rawlog.raw_files import raw_files
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier, Item
from kb.store.tables import reading
from kb.wiki.browser import browser, chromium
from kb.wiki.browser.browser import Pool
from kb.wiki.capture import page
from kb.wiki.crawl import discover, fetch, reduce
from kb.wiki.crawl.client import BATCH, LISTED, WikiApi, find_endpoint
from kb.wiki.crawl.front_end import FrontEnd
from kb.wiki.crawl.http_client import WikiHosts
from kb.wiki.crawl.ids import read_titles
from kb.wiki.crawl.reduce import PAYLOADS
from kb.wiki.parse import answers
from kb.wiki.section import WikiSection

_NAMED = ("robots.txt", "api.php")  # requests of the ledger that have a name of their own
SITE = Phase(kind="site", unit="sites", feeds=("titles",), shown=False)
TITLES = Phase(kind="titles", unit="parts of the list", feeds=("info", "gone"), waits=True)
INFO = Phase(
    kind="info", unit="titles", name="revisions", feeds=("gone", "pages"), batch=BATCH, waits=True
)
GONE = Phase(kind="gone", unit="rounds", feeds=("pages", "files"), waits=True, shown=False)
LAST_SECONDS = 15  # a browser may take longer than its page, to be asked and to answer


def crawl(run: Run, titles: Path | None = None) -> Summary:
    """Crawl the wiki of the profile; `titles` names pages and skips the list.

    Raises UsageError before anything is sent, Stopped when it can go on later.
    """
    named = _named(run, titles) if titles else None
    source = WikiConnector(run, named)
    source.asked = {"titles": str(titles.absolute())} if titles else {}
    return work(run, source, source.summary, phases=source.wanted, facts=source.facts)


def _named(run: Run, titles: Path) -> IdList:
    section = run.profile.section(WikiSection)
    roots = [section.url, *([run.settings.kb_wiki_url] if run.settings.kb_wiki_url else [])]
    return read_titles(titles, section.namespaces, run.progress.say, roots)


class WikiConnector(Connector):
    """The wiki of a profile, or the one that the settings name."""

    name = "wiki"
    payloads = PAYLOADS

    def __init__(self, run: Run, titles: IdList | None = None) -> None:
        section = run.profile.section(WikiSection)
        self.url = run.settings.kb_wiki_url or section.url
        self.section, self._run, self._titles = section, run, titles
        pages = Phase(
            kind="pages",
            unit="pages",
            feeds=("files",),
            workers=run.workers,
            limited=True,
            waits=True,
        )
        files = Phase(kind="files", unit="files", name="images", batch=BATCH, waits=True)
        self.phases: Sequence[Phase] = (SITE, TITLES, INFO, GONE, pages, files)
        self._web = WikiHosts(run, self.url, section.hosts, section.seconds_between)
        self._threads = ThreadPoolExecutor(max(2, run.workers), "wiki-files")
        self._lock = threading.Lock()
        self._api: WikiApi | None = None
        self._pool: Pool | None = None
        self._front = FrontEnd()
        self._moved: set[str] = set()  # pages that are tried alone when all others were shown
        self._file_names: list[str] = []
        self._shown = 0  # pages that were answered for in this run
        self._unread_facts = 0
        self._missing_before = 0
        self._removed: set[str] = set()

    @property
    def wanted(self) -> Sequence[Phase]:
        """The phases of this run: titles that are named need no list."""
        return [phase for phase in self.phases if phase is not TITLES or self._titles is None]

    def identity(self) -> dict[str, str]:
        """The wiki's address. Raises MissingCredential, MissingExtra."""
        self._run.settings.need("kb_contact")
        self._programs = chromium.find_programs()
        return {"wiki": self.url}

    def begin(self, opened: Opened) -> None:
        """Pauses between tries end with the run."""
        super().begin(opened)
        self._web.sleep = partial(opened.sleep, SITE.service)
        self._web.ledger = self._row

    def seeds(self, frontier: Frontier) -> Iterator[dict[str, Any]]:
        """The titles of the list, each once a round."""
        if self._titles is not None:
            tag = discover.named_tag(frontier, again=self._run.again)
            titles = seed_requests(frontier, "info", "titles", self._titles.keys, f"{tag}:")
            yield from ({**request, "round": tag} for request in titles)

    def discover(self, frontier: Frontier) -> None:
        """Begin a round, and reopen items that may succeed now."""
        self._missing_before = reduce.missing(frontier)
        names = self._titles.keys if self._titles else None
        discover.begin_round(frontier, names, self.section.namespaces, again=self._run.again)
        discover.reopen_larger(frontier, self.section)
        discover.reopen_lost(frontier, self._run.root)
        self._removed = self.opened.purged
        if not frontier.open(*(phase.kind for phase in self.wanted)):
            notice = "the wiki crawl is finished; --again looks for what changed"
            self._run.progress.say(notice)

    def leave_out(self, phase: Phase, item: Item) -> str | None:
        """Purged pages are skipped."""
        if phase.kind == "pages" and not self._removed.isdisjoint((item.key, item.payload.title)):
            return "removed"
        return None

    def pack(self, phase: Phase, items: list[Item]) -> list[Item]:
        """As many titles of one round as fit into a URL."""
        return fetch.batch_titles(items) if phase is INFO else items

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """Fetch the items, after robots.txt and the URL of the API."""
        api = self._start()
        if phase is SITE:
            yield api.site()
        elif phase is TITLES:
            asked = items[0].payload
            site = self.opened.frontier.cursor(reduce.SITE + str(asked.round), {})
            yield api.listing(
                asked.round,
                asked.namespace,
                asked.going,
                read=asked.read,
                pages=site.get("pages", 0),
            )
        elif phase is INFO:
            titles = [item.payload.title for item in items]
            answer = api.details(fetch.tag(items[0]), titles=titles)
            yield answer
            for page in answer.response["query"].get("pages", []):
                known = self.opened.frontier.get("pages", str(page.get("pageid")))
                if known and page.get("revisions") and reduce.is_withheld(known[1], page):
                    yield api.revision(known[1].rendered[0])
        elif phase is GONE:
            frontier, root = self.opened.frontier, self._run.root
            yield from fetch.compare(api, frontier, root, items[0].key)
            self._removed = tombstones.keys(root, "wiki")
        elif phase.kind == "pages":
            pool = self._browsers()
            item, frontier = items[0], self.opened.frontier
            try:
                shown = fetch.render_page(
                    self._web,
                    self.section,
                    pool,
                    item,
                    partial(discover.other_pages, frontier, item.key, f"{self.url}/"),
                    self._file_names,
                    front=self._front,
                    alone=item.key in self._moved,
                )
            except Postponed:
                self._moved.add(item.key)
                raise
            if shown.get("revision_id", item.payload.revision_id) != item.payload.revision_id:
                yield api.revision(shown["revision_id"])  # one that the wiki had not listed yet
            status = 200 if shown["outcome"] == "captured" else 0
            yield Answer("renders", shown["url"], {"page_id": item.key}, shown, status)
            if shown["outcome"] != "failed":
                with self._lock:
                    self._shown += 1
                    self._unread_facts += shown.get("unread_facts") or 0
        else:
            others = partial(
                discover.other_files, self.opened.frontier, reached=self._web.rebase_loopback
            )
            yield from fetch.files(
                api, self._web, self.section, self._threads, items, self._front, others
            )

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """Apply an answer to the frontier."""
        reduce.reduce(frontier, kind, envelope)

    def advice(self, phase: Phase, reason: str) -> str:
        """The hint when all pages fail: the cause is the browser or the profile's selectors."""
        if phase.kind != "pages":
            return super().advice(phase, reason)
        if reason == "disallowed":
            return "the wiki's robots.txt bars these pages: ask its operators"
        return (
            f"check [wiki] in {self._run.profile.path}; `kb profile check --online` tries its"
            " selectors"
        )

    def close(self) -> None:
        """End the browsers, close the connections."""
        if self._pool is not None:
            self._pool.close()
        self._threads.shutdown()
        self._web.close()

    def _row(self, request: PreparedRequest) -> Note:
        """Add a row to the ledger before each request except those of the browsers."""
        name = urlsplit(request.url or "").path.rpartition("/")[2]
        return self.opened.spend(Quota("requests"), name if name in _NAMED else "file")

    # -- what is needed before anything is asked -------------------------------------------------

    def _start(self) -> WikiApi:
        """robots.txt and the API, found by the first thread; the others wait."""
        with self._lock:
            if self._api is None:
                self._web.read_robots()
                endpoint = self._endpoint()
                known = self.opened.frontier.get("site", reduce.ANSWERED) is not None
                self._api = WikiApi(endpoint, self._web, known=known)
            return self._api

    def _endpoint(self) -> str:
        """The URL of the API, discovered once per data root and with --again."""
        frontier = self.opened.frontier
        known = frontier.cursor("endpoint")
        same = bool(known) and known[0] == self.url
        if same and not self._run.again:
            endpoint = str(known[1])
        else:
            endpoint = find_endpoint(self._web, self.url, known=same)
            frontier.set_cursor("endpoint", [self.url, endpoint])
        self._web.barred(endpoint)
        return endpoint

    def _browsers(self) -> Pool:
        """The browsers, started with the first page."""
        with self._lock:
            if self._pool is None:
                fetch.remove_scratch(self._run.root)
                self._file_names = answers.file_names(self._run.root)
                self._pool = Pool(self._browser, self.section.page_seconds + LAST_SECONDS)
            return self._pool

    def _browser(self) -> browser.Browser:
        section = self.section
        hosts, origins = browser.reach(self.url, section.hosts)
        return browser.Browser(
            self._programs,
            hosts=hosts,
            origins=origins,
            user_agent=self._web.agent,
            viewport=(section.viewport_width, section.viewport_height),
            page_seconds=section.page_seconds,
            before=page.page_script("settle.js"),
        )

    # -- what was done ---------------------------------------------------------------------------

    def facts(self, phase: Phase) -> dict[str, object]:
        """The progress of the title lists also shows how many titles they had."""
        return {"titles": self.opened.frontier.waiting("info")} if phase is TITLES else {}

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """What this run crawled and asked, and how the whole data root stands.

        `crawled` are this run's answers, as the filter counts them: pages that were captured, are
        barred or can't be shown (`rejected`: too large, an error page), and titles without a page
        (`missing`). `failed` pages and titles are tried again by the next run; `gone` ones left.
        """
        frontier = session.frontier
        kinds = frontier.kinds()
        files = kinds.get("files", {})
        skipped = Counter(reason for _, _, reason, _ in frontier.items("pages", "skipped"))
        robots = skipped.pop("disallowed", 0)
        departed = sum(skipped.pop(reason, 0) for reason in (*reduce.LEFT, "removed"))
        missing = reduce.missing(frontier)
        left = SOURCES["wiki"].left_by(kinds)
        return Summary(
            command="wiki crawl",
            source="wiki",
            counted="pages",
            crawled=self._shown + max(0, missing - self._missing_before),
            crawled_in_all=reduce.crawled(frontier),
            missing=missing,
            rejected=skipped.total(),
            robots=robots,
            failed=sum(
                kinds.get(kind, {}).get("error", 0) for kind in ("site", "titles", "info", "pages")
            ),
            pending=frontier.waiting("pages"),
            gone=departed,
            **({"bad_lines": self._titles.bad_lines} if self._titles else {}),
            unread_facts=self._unread_facts,
            images=files.get("done", 0),
            images_failed=files.get("error", 0) + files.get("skipped", 0),
            requests=self._web.requests,
            left=sum(left.values()),
            left_by=left,
        )


# For estimates, where this data root has nothing to measure yet.
PAGES = 7_000
IMAGES_A_PAGE = 3
MB_A_PAGE = 0.7
SECONDS_A_PAGE = 3  # that a browser takes
# Of a new round: robots.txt, the front page and what it names, the wiki's description twice.
REQUESTS_A_ROUND = 5


def plan_crawl(run: Run, titles: Path | None = None) -> Summary:
    """Titles, pages and image files that are left, by what this data root shows or assumed."""
    section = run.profile.section(WikiSection)
    kinds: dict[str, dict[str, int]] = {}
    listed = False
    path = Layout(run.root).state("wiki")
    if path.is_file():
        with reading.state(path) as frontier:
            kinds = frontier.kinds()
            listed = bool((frontier.cursor("round") or {}).get("done"))
    assumed = [f"{SECONDS_A_PAGE} s a page in each of {run.workers} browsers"]
    asked, lists = to_read(kinds, "info"), 0
    if run.again and listed and not titles and not asked:  # a new round, in which nothing is new
        assumed.append(NOTHING_NEW)
        asked = sum(kinds["pages"].values())
        lists = REQUESTS_A_ROUND + max(len(section.namespaces), math.ceil(asked / LISTED), 1)
    if titles:
        asked = len(_named(run, titles).keys)
    if not titles and not listed and not kinds.get("info"):
        asked = PAGES
        assumed.append(f"{PAGES:,} pages, as the wiki's list was not read yet")
    pages = to_read(kinds, "pages") + (0 if lists else asked)
    done = kinds.get("pages", {}).get("done", 0)
    known_files = sum(kinds.get("files", {}).values())
    per_page = known_files / done if done else IMAGES_A_PAGE
    size = MB_A_PAGE / 1e3
    if done:
        size = sum(path.stat().st_size for path in raw_files(run.root, "wiki")) / done / 1e9
    if pages and not done:
        assumed += [f"{IMAGES_A_PAGE} image files and {MB_A_PAGE} MB a page"]
    files = to_read(kinds, "files") + round(pages * per_page)
    pause = 0.0 if is_loopback(run.settings.kb_wiki_url or section.url) else section.seconds_between
    if pause:
        assumed.append(f"{pause:g} s between requests, unless robots.txt asks for more")
    calls = math.ceil(asked / BATCH) + lists
    seconds = max(pause, SECONDS_A_PAGE / run.workers)
    phases = [
        PlanPhase("titles", asked, requests=calls, hours=calls * pause / 3600),
        PlanPhase("pages", pages, requests=pages, hours=pages * seconds / 3600, gb=pages * size),
        PlanPhase("image files", files, requests=files, hours=files * pause / 3600),
    ]
    return Summary(plan("wiki crawl", "wiki", phases, assumed if pages or files else []))
