"""`kb report`: every figure as SVG, PNG and PDF, and index.html with all of them.

The page needs no other file: images and styles are inside, and there is no script.
"""

import base64
import contextlib
import importlib.util
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from markupsafe import Markup

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.table_catalog import Catalog, empty
from kb.core import signals
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, MissingExtra, UsageError
from kb.core.installation import install_extra
from kb.core.publication import Publication
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import Summary
from kb.core.templates import environment
from kb.look.charts import (
    BLUE,
    GREEN,
    GREY,
    RED,
    Figure,
    applied,
    canvas,
    inline,
    number,
    over_time,
    saved,
)
from kb.look.headings import heading
from kb.report.data import ReportData
from kb.report.figures import FigureMaker
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.state import demo_mark
from kb.store.tables.reading import SANDBOX_MODEL, filtered

_TEMPLATES = Path(__file__).with_name("templates")
_STYLE = resources.files("kb.look").joinpath("style.css")
_LONGEST = 160  # letters of a cell
_HEAVY = 400_000  # bytes of an SVG

_DAYS = 60  # the last ones, when there are more
_COLORS = {"youtube": RED, "wiki": GREEN, "reddit": BLUE}


@dataclass
class ReportSection:
    """One source on the page: its figures and samples, or a line that says what is missing."""

    id: str
    title: str
    figures: list[Figure] = field(default_factory=list)
    samples: list[tuple[str, Sequence[str], Sequence[Sequence[object]]]] = field(
        default_factory=list
    )
    missing: list[str] = field(default_factory=list)


def page(
    title: str,
    as_of: str,
    cards: Sequence[tuple[str, int, str]],
    sections: Sequence[ReportSection],
    notes: Sequence[str],
) -> str:
    """The whole document. `cards` are (what, number, remark). All text is escaped."""
    filters = {"drawing": _drawing, "cell": _cell, "number": number}
    templates = environment(_TEMPLATES, filters, autoescape=True)
    return templates.get_template("page.html.jinja").render(
        title=title,
        as_of=as_of,
        cards=cards,
        sections=sections,
        notes=notes,
        shows_content=any(section.figures or section.samples for section in sections),
        style=Markup(_STYLE.read_text(encoding="utf-8")),
    )


def _drawing(figure: Figure) -> Markup:
    """The figure inside the page: as SVG, unless a screenshot makes that much the heavier."""
    svg, png = figure.files["svg"], figure.files["png"]
    if len(svg) <= _HEAVY or len(svg) <= 2 * len(png):
        return inline(figure)
    image = base64.b64encode(png).decode()
    return Markup('<img src="data:image/png;base64,{}" alt="{}">').format(image, figure.alt)


def _cell(value: object) -> Markup:
    if value is None:
        return Markup('<td class="soft">none</td>')
    if isinstance(value, bool):
        return Markup("<td>{}</td>").format("yes" if value else "no")
    if isinstance(value, int):
        return Markup('<td class="n">{}</td>').format(f"{value:,}")
    if isinstance(value, float):
        return Markup('<td class="n">{}</td>').format(f"{value:,.2f}")
    text = str(value)
    short = text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "…"
    return Markup("<td{}>{}</td>").format(Markup(" class=text") if len(text) > 24 else "", short)


PAGE = "index.html"

SHOWN = [one for one in PUBLISHED.values() if one.shown]


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
    with domain_binding.writing(run, "report"):
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


@contextlib.contextmanager
def _fresh(run: Run) -> Iterator[Path]:
    """A folder that takes the report's place, with its manifest."""
    inputs, settings = manifest.inputs(run.root, "report"), freshness.settings(run, "report")
    home = Catalog(run.root.absolute()).workplace
    with manifest.replacing(home, "report", inputs=inputs, settings=settings) as build:
        yield build.folder


def _report(run: Run, out: Path | None) -> Summary:
    with ReportData(run) as data:
        if not any(data.files(name) for one in SHOWN for name in one.shown):
            raise empty(run.root)
        sections = [*(_section(run, data, one) for one in SHOWN), _services(run, data)]
        cards = [
            (name.partition("/")[2], data.count(name), one.title)
            for one in SHOWN
            for name in one.shown
            if data.files(name)
        ]
        notes = _notes(run)
        html = page(
            f"{run.profile.title}: what was collected", data.newest(), cards, sections, notes
        )
        place = (out or Layout(data.catalog.workplace).report).expanduser().absolute()
    if out is not None and place.exists() and not (place / PAGE).is_file():
        raise UsageError(f"--out {out} exists and is not a report", hint="name a new folder")
    with _fresh(run) if out is None else replacing_folder(place) as folder:
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


def _section(run: Run, data: ReportData, of: Publication) -> ReportSection:
    section = ReportSection(of.name, of.title, _drawn(run, data, of.name, of.figures()))
    for name, columns in of.sampled.items():
        if run.profile.report.samples and data.count(name):
            rows = data.samples(name, columns, run.profile.report.samples)
            section.samples.append(
                (
                    f"Some {name.partition('/')[2]}",
                    [heading(name, column) for column in columns],
                    rows,
                )
            )
    if not section.figures:
        section.missing.append(f"No data of {of.title} yet: {of.hint}.")
    return section


def _services(run: Run, data: ReportData) -> ReportSection:
    """What the services were asked."""
    section = ReportSection("services", "Services", _drawn(run, data, "services", [quota]))
    if not section.figures:
        section.missing.append("No ledger: nothing was asked of a service yet.")
    return section


def _drawn(run: Run, data: ReportData, name: str, makers: Sequence[FigureMaker]) -> list[Figure]:
    figures: list[Figure] = []
    with run.progress.task(f"report {name}", total=len(makers), unit="figures") as task:
        for make in makers:
            signals.stop.check()
            with applied():
                made = make(data, run.profile)
            if made is not None:
                figures += made if isinstance(made, tuple) else (made,)
            task.advance()
    return figures


def _notes(run: Run) -> list[str]:
    """What a reader must know before believing the figures."""
    notes = demo_mark.note(run.root)
    if any(filtered(run.root, source).get("model") == SANDBOX_MODEL for source in SOURCES):
        notes.append(
            "Toxicity scores are those of the sandbox's tiny model: "
            "they mean nothing about real texts."
        )
    return notes


def quota(data: ReportData, profile: Profile) -> Figure | None:
    """Units of YouTube's quota, or requests of the others, over days; one panel a limit."""
    ledger = data.ledgers()
    if not ledger:
        return None
    days = sorted({day for _, day, _, _, _ in ledger})[-_DAYS:]
    buckets = sorted({(source, bucket) for source, _, bucket, _, _ in ledger})
    in_units = {  # the others' ledgers count a request as a unit
        (source, bucket) for source, _, bucket, _, units in ledger if units and source == "youtube"
    }
    rows = [
        (day, _label(source, bucket), units if (source, bucket) in in_units else requests)
        for source, day, bucket, requests, units in ledger
    ]
    sheet, panels = canvas(0.5 + 1.25 * len(buckets), rows=len(buckets), squeeze=False)
    sums = []
    for index, (place, axes) in enumerate(zip(buckets, panels[:, 0], strict=True)):
        spent = {day: n for day, label, n in rows if label == _label(*place)}
        unit = "units" if place in in_units else "requests"
        last = index == len(buckets) - 1
        over_time(
            days,
            [spent.get(day, 0) for day in days],
            x="day" if last else "",
            y=unit,
            color=_COLORS.get(place[0], GREY),
            axes=axes,
            labels=4,
        )
        axes.set_title(_title(*place), loc="left", fontsize=10)
        axes.tick_params(axis="x", labelbottom=last)
        axes.yaxis.get_major_locator().set_params(nbins=3)
        sums.append(f"{_title(*place)} {sum(spent.values()):,} {unit}")
    sheet.align_ylabels()
    return Figure(
        "quota",
        "What the services were asked",
        "Spent a day, each service and limit on a scale of its own: units of YouTube's quota, "
        "requests elsewhere.",
        "Bars by day, one panel for each service and limit; in all " + ", ".join(sums) + ".",
        saved(sheet),
        ("day", "bucket", "spent"),
        rows,
    )


def _label(source: str, bucket: str) -> str:
    return source if bucket == source else f"{source} {bucket}"


def _title(source: str, bucket: str) -> str:
    name = SOURCES[source].title if source in SOURCES else source
    return name if bucket in (source, "requests") else f"{name}: {bucket}"
