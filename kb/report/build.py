"""`kb report`: every figure as SVG, PNG and PDF, and one page with all of them."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kb.artifacts import belonging
from kb.artifacts.catalog import Catalog, empty
from kb.core import signals
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, MissingExtra, UsageError
from kb.core.installation import install_extra
from kb.core.profile import Profile
from kb.core.sources import SOURCES
from kb.core.verdict import Summary
from kb.report import cloud, links, pairs, reddit, wikipage, youtube
from kb.report.data import ReportData
from kb.report.dates import dates
from kb.report.elements import elements
from kb.report.funnel import funnel
from kb.report.logarithmic import scores, views
from kb.report.page import ReportSection, page
from kb.report.services import quota
from kb.report.style import BLUE, GREEN, PURPLE, Figure, applied
from kb.report.toxicity import toxicity
from kb.schema import table
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.reading import SANDBOX_MODEL, filtered

Maker = Callable[[ReportData, "Profile"], "Figure | tuple[Figure, ...] | None"]
PAGE = "index.html"
SAMPLES = {
    "youtube/videos": (
        "title",
        "view_count",
        "like_count",
        "duration_s",
        "transcript_kind",
        "published_at",
    ),
    "wiki/pages": ("title", "word_count", "page_width", "page_height", "license", "url"),
    "reddit/posts": ("title", "type", "score", "num_comments", "created_utc"),
    "pairs/pairs": (
        "keyword",
        "keyword_kind",
        "text",
        "token_count",
        "clip_start_s",
        "clip_end_s",
        "video_id",
    ),
}
TITLES = {
    "youtube": "YouTube",
    "wiki": "Wiki",
    "reddit": "Reddit",
    "pairs": "Video-text pairs",
    "links": "Entities",
    "services": "Services",
}
TABLES = {
    "youtube": ("youtube/videos",),
    "wiki": ("wiki/pages", "wiki/elements", "wiki/images"),
    "reddit": ("reddit/posts", "reddit/comments"),
    "pairs": ("pairs/pairs",),
    "links": ("links/entities", "links/links"),
}
NEXT = {
    "youtube": "run `kb youtube crawl`, then `kb youtube filter`",
    "wiki": "run `kb wiki crawl`, then `kb wiki filter`",
    "reddit": "run `kb reddit crawl` or `kb reddit import FILE`, then `kb reddit filter`",
    "pairs": "run `kb pairs` after `kb youtube filter`",
    "links": "run `kb links` after the filters",
    "services": "nothing was asked of a service yet",
}


MAKERS: dict[str, list[Maker]] = {  # the figures of a source, in the order of the page
    "youtube": [
        partial(funnel, name="youtube/videos"),
        youtube.durations,
        views,
        partial(dates, table="youtube/videos", column="published_at", what="published", color=BLUE),
        youtube.channels,
        youtube.transcripts,
        partial(
            toxicity, table="youtube/videos", columns=("toxicity_title", "toxicity_description")
        ),
        partial(cloud.words, table="youtube/videos", columns=("title",)),
    ],
    "wiki": [
        wikipage.page,
        partial(funnel, name="wiki/pages"),
        elements,
        partial(
            dates, table="wiki/pages", column="revision_timestamp", what="revised", color=GREEN
        ),
        partial(toxicity, table="wiki/pages", columns=("toxicity",)),
    ],
    "reddit": [
        partial(funnel, name="reddit/posts"),
        reddit.post_types,
        scores,
        partial(dates, table="reddit/posts", column="created_utc", what="made", color=PURPLE),
        partial(funnel, name="reddit/comments"),
        partial(toxicity, table="reddit/posts", columns=("toxicity_title", "toxicity_body")),
        partial(toxicity, table="reddit/comments", columns=("toxicity_body",)),
        partial(cloud.words, table="reddit/posts", columns=("title", "body")),
    ],
    "pairs": [pairs.keywords, pairs.lengths],
    "links": [links.most, links.least, links.known],
    "services": [quota],
}


def report(run: Run, out: Path | None = None) -> Summary:
    """Write `report/` anew, or `out`; of a download it goes to the user's cache by default.

    Raises MissingExtra without the figures' packages, FatalError where there is nothing to show,
    DamagedData.
    """
    missing = [
        name
        for name in ("matplotlib", "wordcloud", "PIL")
        if importlib.util.find_spec(name) is None
    ]
    if missing:
        raise MissingExtra(f"figures need {', '.join(missing)}", hint=install_extra("figures"))
    if not Catalog(run.root.absolute()).views:  # before anything is written
        raise empty(run.root)
    with belonging.writing(run, "report"):
        return _report(run, out)


def report_again(run: Run) -> None:
    """The report of today's rows, where there is one; it goes where its packages are not there."""
    place = Layout(run.root).report
    if not place.exists():
        return
    try:
        report(run)
    except (MissingExtra, FatalError) as error:
        if isinstance(error, DamagedData):
            raise
        shutil.rmtree(place)


def _report(run: Run, out: Path | None) -> Summary:
    with ReportData(run) as data:
        if not any(data.files(name) for names in TABLES.values() for name in names):
            raise empty(run.root)
        sections = [_section(run, data, source) for source in TITLES]
        cards = [
            (f"{name.partition('/')[2]}", data.count(name), TITLES[source])
            for source, names in TABLES.items()
            for name in names
            if data.files(name)
        ]
        notes = _notes(run)
        html = page(
            f"{run.profile.title}: what was collected", data.newest(), cards, sections, notes
        )
        place = (out or Layout(data.catalog.workplace).report).expanduser().absolute()
    if out is not None and place.exists() and not (place / PAGE).is_file():
        raise UsageError(f"--out {out} exists and is not a report", hint="name a new folder")
    with replacing_folder(place) as folder:
        for section in sections:
            for figure in section.figures:
                for suffix, content in figure.files.items():
                    (folder / f"{figure.name}.{suffix}").write_bytes(content)
        (folder / PAGE).write_text(html, encoding="utf-8")
    return Summary(
        command="report",
        figures=sum(len(section.figures) for section in sections),
        page=str(place / PAGE),
        without=", ".join(section.title for section in sections if section.missing) or None,
    )


def _section(run: Run, data: ReportData, source: str) -> ReportSection:
    section = ReportSection(source, TITLES[source])
    todo = MAKERS[source]
    with run.progress.task(f"report {source}", total=len(todo), unit="figures") as task:
        for make in todo:
            signals.stop.check()
            with applied():
                made = make(data, run.profile)
            if made is not None:
                section.figures += made if isinstance(made, tuple) else (made,)
            task.advance()
    for name in TABLES.get(source, ()):
        if name in SAMPLES and run.profile.report.samples and data.count(name):
            rows = data.samples(name, SAMPLES[name], run.profile.report.samples)
            section.samples.append(
                (
                    f"Some {name.partition('/')[2]}",
                    [_head(name, column) for column in SAMPLES[name]],
                    rows,
                )
            )
    if not section.figures:
        section.missing.append(
            f"No data of {TITLES[source]} yet: {NEXT[source]}."
            if source != "services"
            else f"No ledger: {NEXT[source]}."
        )
    return section


def _head(name: str, column: str) -> str:
    """A column's name for people, with its unit where that is more than what it counts."""
    unit = table(name).column(column).unit
    words = column.removesuffix("_s").replace("_", " ")
    return f"{words} ({unit})" if unit in ("s", "px", "CSS px", "UTC") else words


def _notes(run: Run) -> list[str]:
    """What a reader must know before believing the figures."""
    if any(filtered(run.root, source).get("model") == SANDBOX_MODEL for source in SOURCES):
        return [
            (
                "Toxicity scores are those of the sandbox's tiny model: "
                "they mean nothing about real texts."
            )
        ]
    return []
