"""`kb report`: every figure as SVG and PNG, if asked for as PDF, and index.html with all of them.

The page needs no other file: images and styles are inside, and there is no script.
"""

import base64
import contextlib
import importlib.util
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import NamedTuple, Protocol

from markupsafe import Markup

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.table_catalog import Catalog, empty
from kb.core import signals
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import MissingExtra, UsageError
from kb.core.installation import install_extra
from kb.core.sources import PUBLISHED, SOURCES, Publication, SourceDeclaration, made_of
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
    shortened,
)
from kb.look.headings import heading, plain, reading
from kb.report.data import ReportData
from kb.report.figures import FigureMaker
from kb.schema import table
from kb.store.atomic import replacing_folder
from kb.store.layout import Layout
from kb.store.state import demo_mark
from kb.store.tables.reading import SANDBOX_MODEL, filtered

_TEMPLATES = Path(__file__).with_name("templates")
_STYLE = resources.files("kb.look").joinpath("style.css")
_LONGEST = 160  # letters of a cell
_COLUMNS = 3  # of figures beside each other, on a wide screen
_PER_LINE = 58  # letters of a caption
_DAYS = 60  # the last ones, when there are more
_COLORS = {"red": RED, "green": GREEN, "blue": BLUE}


@dataclass
class ReportSection:
    """One source on the page: its figures and samples, or a line that says what is missing."""

    id: str
    title: str
    figures: list[Figure] = field(default_factory=list)
    samples: list[tuple[str, Sequence[str], Sequence[Sequence[object]]]] = field(
        default_factory=list
    )
    missing: str = ""

    @property
    def columns(self) -> list[list[Figure]]:
        """The figures that stand in columns, in their order: as even as whole figures allow."""
        figures = [figure for figure in self.figures if not figure.gallery]
        heights = [_height(figure) for figure in figures]
        inner = range(1, len(figures))
        cuts = [
            (0, *chosen, len(figures))
            for chosen in itertools.combinations(inner, min(_COLUMNS, max(len(figures), 1)) - 1)
        ]
        ends = min(
            cuts, key=lambda ends: max(sum(heights[a:b]) for a, b in itertools.pairwise(ends))
        )
        return [figures[a:b] for a, b in itertools.pairwise(ends) if a < b]


class Linked(NamedTuple):
    """A text that leads to an address."""

    text: str
    url: str


def page(
    title: str,
    as_of: str,
    totals: Sequence[tuple[str, float]],
    sections: Sequence[ReportSection],
    notes: Sequence[str],
) -> str:
    """The whole document. `totals` are (what, number). All text is escaped."""
    filters = {"drawing": _drawing, "cell": _cell, "amount": _amount, "numeric": _numeric}
    templates = environment(_TEMPLATES, filters, autoescape=True)
    return templates.get_template("page.html.jinja").render(
        title=title,
        as_of=as_of,
        totals=totals,
        sections=sections,
        notes=notes,
        shows_content=any(section.figures or section.samples for section in sections),
        style=Markup(_STYLE.read_text(encoding="utf-8")),
    )


def _height(figure: Figure) -> float:
    """About how many CSS pixels a figure takes, with its title and caption."""
    size = re.search(rb'viewBox="0 0 ([0-9.]+) ([0-9.]+)"', figure.files["svg"])
    points = float(size[2]) if size else 0.0
    return points * 96 / 72 + 110 + 20 * (len(figure.caption) // _PER_LINE)


def _drawing(figure: Figure) -> Markup:
    """The figure inside the page: as SVG, whose colours follow the reader's theme; a screen as the
    picture that it is.
    """
    if not figure.screen:
        return inline(figure)
    png = figure.files["png"]
    wide = int.from_bytes(png[16:20], "big") // 2  # drawn with two pixels for each of the page's
    image = Markup('<img src="data:image/png;base64,{}" alt="{}" width="{}">')
    return image.format(base64.b64encode(png).decode(), figure.alt, wide)


def _amount(n: float) -> str:
    """A total: whole, or two digits of what is less than ten."""
    return f"{n:.2g}" if n % 1 and n < 10 else number(round(n))


def _numeric(rows: Sequence[Sequence[object]]) -> list[bool]:
    """Which columns hold numbers: their headings stand over these."""
    return [
        all(isinstance(value, int | float | None) and not isinstance(value, bool) for value in of)
        and any(value is not None for value in of)
        for of in zip(*rows, strict=True)
    ]


def _cell(value: object, among_numbers: bool = False) -> Markup:
    if value is None:
        return Markup('<td class="soft{}">–</td>').format(" n" if among_numbers else "")
    if (known := plain(value)) is not None:
        is_number = Markup("" if isinstance(value, bool) else ' class="n"')
        return Markup("<td{}>{}</td>").format(is_number, known)
    words = value.text if isinstance(value, Linked) else str(value)
    text = shortened(" ".join(words.split()), _LONGEST)
    kind = Markup(' class="text"') if len(text) > 24 else ""
    if isinstance(value, Linked):
        link = Markup('<td{}><a href="{}" rel="noreferrer noopener">{}</a></td>')
        return link.format(kind, value.url, text)
    return Markup("<td{}>{}</td>").format(kind, text)


PAGE = "index.html"

SHOWN = [shown for shown in PUBLISHED.values() if shown.shown]


def check_extra() -> None:
    """Raises MissingExtra without the packages that figures need."""
    missing = [
        name
        for name in ("matplotlib", "wordcloud", "PIL")
        if importlib.util.find_spec(name) is None
    ]
    if missing:
        raise MissingExtra(f"figures need {', '.join(missing)}", hint=install_extra("figures"))


class Drawn(Protocol):
    """What is published, and has figures in the report."""

    @property
    def declared(self) -> Publication:
        """Its declaration."""

    def figures(self) -> Sequence[FigureMaker]:
        """What is drawn of it."""


def report(
    run: Run, published: Mapping[str, Drawn], out: Path | None = None, figures: bool = False
) -> Summary:
    """Write `report/` anew, or `out`; of a download it goes to the user's cache by default.
    `figures`: word clouds, which take the longest to draw, and PDFs as well.

    Raises MissingExtra without the figures' packages, FatalError where there is nothing to show,
    DamagedData.
    """
    check_extra()
    if not Catalog(run.root.absolute()).views:  # before anything is written
        raise empty(run.root)
    with domain_binding.writing(run, "report"):
        return _report(run, published, out, figures)


@contextlib.contextmanager
def _fresh(run: Run, figures: bool) -> Iterator[Path]:
    """A folder that takes the report's place, with its manifest."""
    inputs, settings = manifest.inputs(run.root, "report"), freshness.settings(run, "report")
    home = Catalog(run.root.absolute()).workplace
    with manifest.replacing(home, "report", inputs=inputs, settings=settings) as build:
        build.figures = {"figures": figures}
        yield build.folder


def _report(run: Run, published: Mapping[str, Drawn], out: Path | None, with_all: bool) -> Summary:
    with ReportData(run, clouds=with_all) as data, applied():
        there = [
            publication
            for publication in SHOWN
            if any(data.count(name) for name in publication.shown)
        ]
        if not any(data.files(name) for publication in SHOWN for name in publication.shown):
            raise empty(run.root)
        wanted = [
            publication
            for publication in SHOWN
            if publication in there or _configured(run.profile, publication.name)
        ]
        sections = [
            *(_section(run, data, published[publication.name]) for publication in wanted),
            _services(run, data),
        ]
        totals = [
            (what, n)
            for publication in there
            for what, name, count in publication.totals
            or [(name.partition("/")[2], name, "count(*)") for name in publication.shown]
            if (n := data.total(name, count)) is not None
        ]
        notes = _notes(run)
        html = page(
            f"{run.profile.title}: what was collected", data.newest(), totals, sections, notes
        )
        place = (out or Layout(data.catalog.workplace).report).expanduser().absolute()
    if out is not None and place.exists() and not (place / PAGE).is_file():
        raise UsageError(f"--out {out} exists and is not a report", hint="name a new folder")
    suffixes = ("svg", "png", "pdf") if with_all else ("svg", "png")
    fresh = _fresh(run, with_all) if out is None else replacing_folder(place)
    with fresh as folder, applied():
        for section in sections:
            for figure in section.figures:
                for suffix in suffixes:
                    (folder / f"{figure.name}.{suffix}").write_bytes(figure.files[suffix])
        (folder / PAGE).write_text(html, encoding="utf-8")
    return Summary(
        command="report",
        figures=sum(len(section.figures) for section in sections),
        page=str(place / PAGE),
        without=", ".join(section.title for section in sections if section.missing) or None,
    )


def _configured(profile: Profile, name: str) -> bool:
    """Whether the profile has what something is made of, and has not left it out itself."""
    sources = any(getattr(profile, source) is not None for source in made_of(name))
    return sources and getattr(profile, name, True) is not None


def _section(run: Run, data: ReportData, published: Drawn) -> ReportSection:
    of = published.declared
    section = ReportSection(of.name, of.title, _drawn(run, data, of.name, published.figures()))
    for name, columns in of.sampled.items():
        if run.profile.report.samples and data.count(name):
            section.samples.append(_sample(run, data, of, name, columns))
    if not section.figures:
        section.missing = f"No data of {of.title} yet: {of.hint}."
    return section


def _sample(
    run: Run, data: ReportData, of: Publication, name: str, columns: Sequence[str]
) -> tuple[str, Sequence[str], Sequence[Sequence[object]]]:
    """(caption, headings, rows) of some rows of a table; the first column leads to its item."""
    address = "url" if "url" in table(name).names() else table(name).key[0]
    rows = []
    for key, *values in data.samples(name, (address, *columns), run.profile.report.samples):
        url = key if address == "url" else ""
        if isinstance(of, SourceDeclaration) and not url:
            url = of.url_of(str(key))
        first = Linked(values[0], url) if url.startswith("http") and values[0] else values[0]
        words = [
            reading(name, column, value) if isinstance(value, str) else value
            for column, value in zip(columns[1:], values[1:], strict=True)
        ]
        rows.append((first, *words))
    headings = [heading(name, column) for column in columns]
    return f"Some {name.partition('/')[2]}", headings, rows


def _services(run: Run, data: ReportData) -> ReportSection:
    """What the services were asked."""
    section = ReportSection("services", "Services", _drawn(run, data, "services", [quota]))
    spent: dict[tuple[str, str], list[tuple[str, int, int]]] = {}
    for source, day, bucket, requests, units in data.ledgers():
        spent.setdefault((source, bucket), []).append((day, requests, units))
    rows = [
        (
            _title(*place),
            sum(requests for _, requests, _ in days),
            max(requests for _, requests, _ in days),
            sum(units for _, _, units in days) if SOURCES[place[0]].counts_units else None,
            days[0][0],
            days[-1][0],
        )
        for place, days in sorted(spent.items())
    ]
    if rows:
        head = ("Service", "Requests", "Most in a day", "Units of quota", "First day", "Last day")
        section.samples.append(("All requests", head, rows))
    if not section.figures:
        section.missing = (
            "No ledger: nothing was asked of a service from this folder. `kb doctor --online`"
            " asks each service once."
        )
    return section


def _drawn(run: Run, data: ReportData, name: str, makers: Sequence[FigureMaker]) -> list[Figure]:
    figures: list[Figure] = []
    with run.progress.task(f"report {name}", total=len(makers), unit="figures") as task:
        for make in makers:
            signals.stop.raise_if_asked()
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
    """Units of a quota, or requests where there is none, over days; one panel a limit."""
    ledger = data.ledgers()
    if not ledger:
        return None
    days = sorted({day for _, day, _, _, _ in ledger})[-_DAYS:]
    buckets = sorted({(source, bucket) for source, _, bucket, _, _ in ledger})
    in_units = {  # the others' ledgers count a request as a unit
        (source, bucket)
        for source, _, bucket, _, units in ledger
        if units and SOURCES[source].counts_units
    }
    rows = [
        (day, _label(source, bucket), units if (source, bucket) in in_units else requests)
        for source, day, bucket, requests, units in ledger
    ]
    sheet, panels = canvas(0.5 + 1.05 * len(buckets), rows=len(buckets), squeeze=False)
    sums = []
    for index, (place, axes) in enumerate(zip(buckets, panels[:, 0], strict=True)):
        spent = {day: n for day, label, n in rows if label == _label(*place)}
        unit = "units" if place in in_units else "requests"
        last = index == len(buckets) - 1
        over_time(
            days,
            [spent.get(day, 0) for day in days],
            x="day (UTC)" if last else "",
            y=unit,
            color=_COLORS.get(SOURCES[place[0]].color, GREY),
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
        "Spent a day, each service and limit on a scale of its own: units of a quota, requests"
        " where there is none.",
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
