"""Estimates the remaining work of a wiki crawl. Sends and writes nothing."""

import math
from pathlib import Path

from kb.core.config.addresses import is_loopback
from kb.core.config.profile.collecting import WikiSection
from kb.core.context import Run
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPhase, plan, to_read
from kb.store.layout import Layout
from kb.store.tables import reading
from kb.wiki.crawl.ids import read_titles

BATCH = 50  # titles a request
# Used only where this data root has nothing to measure.
PAGES = 7_000
IMAGES_A_PAGE = 3
MB_A_PAGE = 0.7
SECONDS_A_PAGE = 3  # that a browser takes


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
    asked = to_read(kinds, "info")
    if titles:
        asked = len(read_titles(titles, section.namespaces, run.progress.say).keys)
    if not titles and not listed and not kinds.get("info"):
        asked = PAGES
        assumed.append(f"{PAGES:,} pages, as the wiki's list was not read yet")
    pages = asked + to_read(kinds, "pages")
    done = kinds.get("pages", {}).get("done", 0)
    known_files = sum(kinds.get("files", {}).values())
    each = known_files / done if done else IMAGES_A_PAGE
    size = MB_A_PAGE / 1e3
    if done:
        raw = Layout(run.root).raw("wiki").rglob("*")
        size = sum(path.stat().st_size for path in raw if path.is_file()) / done / 1e9
    if pages and not done:
        assumed += [f"{IMAGES_A_PAGE} image files and {MB_A_PAGE} MB a page"]
    files = to_read(kinds, "files") + round(pages * each)
    pause = 0.0 if is_loopback(run.settings.kb_wiki_url or section.url) else section.seconds_between
    if pause:
        assumed.append(f"{pause:g} s between requests, unless robots.txt asks for more")
    calls = math.ceil(asked / BATCH)
    seconds = max(pause, SECONDS_A_PAGE / run.workers)
    phases = [
        PlanPhase("titles", asked, requests=calls, hours=calls * pause / 3600),
        PlanPhase("pages", pages, requests=pages, hours=pages * seconds / 3600, gb=pages * size),
        PlanPhase("image files", files, requests=files, hours=files * pause / 3600),
    ]
    return Summary(plan("wiki crawl", "wiki", phases, assumed if pages or files else []))
