"""The charts of the report and of `kb explore`: their kinds, how all of them look, and how they
are saved, as the same bytes for the same data.

Colours: Okabe and Ito's palette, told apart with any colour vision and on paper. Figures are as
wide as a phone's screen in points, so that their labels stay readable on one. Every axis says what
it counts.
"""

import contextlib
import functools
import io
import itertools
import logging
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

from markupsafe import Markup, escape

# Behind a number: the grid's lines stop before it.
HALO = {"facecolor": "white", "edgecolor": "none", "pad": 1.2}

BLUE, ORANGE, GREEN, RED, SKY, PURPLE = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
)
INK, GREY, PALE = "#1F2933", "#52606D", "#D9E2EC"
WORDS = (BLUE, "#007355", "#B34A00", INK, "#8F4A75")  # dark enough for words on white
# Each colour's variable in style.css, which has it in a light and a dark theme.
_VARIABLES = {
    "#ffffff": "card",
    INK.lower(): "ink",
    GREY.lower(): "soft",
    PALE.lower(): "line",
    BLUE.lower(): "blue",
    ORANGE.lower(): "orange",
    GREEN.lower(): "green",
    RED.lower(): "red",
    SKY.lower(): "sky",
    PURPLE.lower(): "purple",
    WORDS[1].lower(): "green-word",
    WORDS[2].lower(): "red-word",
    WORDS[4].lower(): "purple-word",
}
FONT = "DejaVu Sans"  # comes with matplotlib: the same letters everywhere
WIDTH = 4.6  # inches
PIXELS = 200  # per inch, of the PNG
_LONGEST = 26  # letters of a label
# Steps between ticks of an axis of seconds or minutes.
SIXTIETHS = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600)
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_YEARS = (12, 24, 60, 120, 240, 600, 1200)  # in months
_RULES: dict[str, Any] = {
    "font.family": FONT,
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": False,
    "grid.color": PALE,
    "grid.linewidth": 0.8,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "legend.frameon": False,
    "legend.fontsize": 9,
    "svg.hashsalt": "lorecrawl",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # letters stay letters; journals refuse type 3
    "path.simplify": True,
    "text.parse_math": False,  # a dollar in somebody's title is a dollar
}


def bars(
    labels: Sequence[str],
    values: Sequence[float],
    *,
    unit: str,
    notes: Sequence[str] | None = None,
    colors: Sequence[str] | str = BLUE,
    axes: Any = None,
) -> Any:
    """Horizontal bars, the first on top, each with its number written behind it."""
    sheet, axes = canvas(rows_height(len(labels))) if axes is None else (axes.figure, axes)
    places = range(len(labels))
    axes.barh(places, values, color=colors, height=0.72)
    axes.set_yticks(places, labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel(unit)
    counts(axes.xaxis)
    axes.set_xlim(0, max([*values, 1]) * 1.32)
    for place, value, note in zip(
        places, values, notes or [number(value) for value in values], strict=True
    ):
        axes.text(
            value + max([*values, 1]) * 0.012,
            place,
            note,
            va="center",
            ha="left",
            fontsize=9,
            color=GREY if not value else None,
            bbox=HALO,
        )
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")
    return sheet


def rows_height(rows: int) -> float:
    """Inches of a figure of so many horizontal bars, with its axis: many stand closer."""
    return 0.75 + max(2, rows) * (0.28 if rows <= 14 else 0.21)


def histogram(
    edges: Sequence[float],
    values: Sequence[int],
    *,
    x: str,
    y: str,
    log: bool = False,
    steps: Sequence[float] = (),
    labels: int = 7,
    color: str = BLUE,
    axes: Any = None,
    marks: Sequence[tuple[float, str]] = (),
) -> Any:
    """Bars between edges; `log` for a logarithmic x axis; `steps` between its ticks, where others
    than 1, 2, 5, 10 … read better; `marks`: vertical lines with a word.
    """
    from matplotlib.ticker import MultipleLocator

    sheet, axes = canvas(2.9) if axes is None else (axes.figure, axes)
    widths = [high - low for low, high in itertools.pairwise(edges)]
    axes.bar(
        edges[:-1], values, widths, align="edge", color=color, edgecolor="white", linewidth=0.6
    )
    if log:
        axes.set_xscale("log")
        powers(axes.xaxis)
    else:
        apart = step(edges[-1] - edges[0], labels, steps)
        axes.xaxis.set_major_locator(MultipleLocator(apart))
        axes.xaxis.set_major_formatter(lambda value, _: number(value))
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_xlim(edges[0], edges[-1])
    counts(axes.yaxis)
    axes.grid(axis="y")
    top = max([*values, 1])
    axes.set_ylim(0, top * (1.22 if marks else 1.06))
    for place, word in marks:
        axes.axvline(place, color=GREY, linewidth=1.2, linestyle=(0, (4, 2)), ymax=0.86)
        far = place > (edges[0] * edges[-1]) ** 0.5 if log else place > (edges[0] + edges[-1]) / 2
        axes.annotate(
            word,
            (place, top * 1.18),
            xytext=(-4 if far else 4, 0),
            textcoords="offset points",
            ha="right" if far else "left",
            va="top",
            fontsize=9,
        )
    return sheet


def over_time(
    periods: Sequence[str],
    values: Sequence[int],
    *,
    x: str,
    y: str,
    color: str = BLUE,
    axes: Any = None,
    labels: int = 5,
) -> Any:
    """One bar a period (a day, month, year or decade), in order; at most `labels` of them are named
    below: those with which a round number of years, months, days or a week begins.
    """
    sheet, axes = canvas(2.9) if axes is None else (axes.figure, axes)
    axes.bar(range(len(periods)), values, width=0.86, color=color)
    room = max(0, 4 - len(periods)) / 2  # a single bar is no wall
    axes.set_xlim(-0.6 - room, len(periods) - 0.4 + room)
    axes.set_xticks(*zip(*_calendar(periods, labels), strict=True))
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_ylim(0, max([*values, 1]) * 1.08)
    counts(axes.yaxis)
    axes.grid(axis="y")
    return sheet


def _calendar(periods: Sequence[str], most: int) -> list[tuple[int, str]]:
    """Places of the periods that are named, and their names: a year only where it begins."""
    parts = [period.rstrip("s").split("-") for period in periods]
    years = [int(part[0]) for part in parts]
    steps: tuple[float, ...] = ()
    if len(parts[0]) == 1:
        pace = years[1] - years[0] if len(years) > 1 else 1
        since, names = [year // pace for year in years], list(periods)
    elif len(parts[0]) == 2:
        since = [int(year) * 12 + int(month) - 1 for year, month in parts]
        names, steps = [_MONTHS[month % 12] for month in since], (1, 2, 3, 6, *_YEARS)
    else:
        days = [date.fromisoformat(period) for period in periods]
        since = [day.toordinal() - 1 for day in days]  # the first one was a Monday
        names, steps = [f"{day.day} {_MONTHS[day.month - 1]}" for day in days], (1, 2, 7, 14, 28)
    every = max(1, step(len(periods), most, steps))
    named: list[tuple[int, str]] = []
    last = 0
    for place, (at, year, name) in enumerate(zip(since, years, names, strict=True)):
        if at % every == 0:
            of_year = "" if not steps or year == last else f"\n{year}"
            by_year = len(parts[0]) == 2 and every >= _YEARS[0]
            named.append((place, str(year) if by_year else name + of_year))
            last = year
    return named


def step(span: float, most: float, of: Sequence[float] = ()) -> float:
    """The smallest step of which at most so many make up the span: of those that are given, else
    1, 2 or 5 times a power of ten.
    """
    least = span / most
    if not of or least > of[-1]:
        power = 10.0 ** math.floor(math.log10(least)) if least > 0 else 1.0
        of = [power * times for times in (1, 2, 5, 10)]
    return next((step for step in of if step >= least * (1 - 1e-9)), of[-1])


def even(low: float, high: float, bins: int = 30, steps: Sequence[float] = ()) -> list[float]:
    """Edges of at most so many bins of one round width (see `step`), from below `low` to above
    `high`.
    """
    width = step(high - low, bins - 1, steps)
    first, last = math.floor(low / width + 1e-9), math.ceil(high / width - 1e-9)
    return [round(edge * width, 9) for edge in range(first, max(last, first + 1) + 1)]


class SavedSheet:
    """A drawn sheet as the bytes of a file: `["svg"]`, `["png"]` or `["pdf"]`, each made when it is
    first asked for, without dates or version names.
    """

    def __init__(self, sheet: Any, pixels: int) -> None:
        self._sheet, self._pixels = sheet, pixels
        self._files: dict[str, bytes] = {}

    def __getitem__(self, kind: str) -> bytes:
        if kind not in self._files:
            file = io.BytesIO()
            with applied():
                self._sheet.savefig(file, format=kind, dpi=self._pixels, **FORMATS[kind])
            self._files[kind] = file.getvalue()
        return self._files[kind]


@dataclass(frozen=True)
class Figure:
    """One finished figure. `rows` are the numbers behind it, for those who can't see it."""

    name: str
    title: str
    caption: str
    alt: str
    files: SavedSheet
    head: Sequence[str] = ()
    rows: Sequence[Sequence[object]] = ()
    screen: bool = False  # shows a screen, whose colours are its own
    gallery: bool = False  # shown in a row with others of its kind, above the columns


def applied() -> Any:
    """A context in which whatever is drawn looks like the rest; within another one nothing changes,
    as setting the rules takes as long as drawing a panel.
    """
    import matplotlib

    if matplotlib.rcParams["svg.hashsalt"] == _RULES["svg.hashsalt"]:
        return contextlib.nullcontext()
    rules: Any = _RULES  # its stubs list every name that matplotlib knows
    return matplotlib.rc_context(rules)


def canvas(
    height: float, columns: int = 1, rows: int = 1, width: float = WIDTH, **options: Any
) -> tuple[Any, Any]:
    """A figure (inches) and its axes, drawn without any display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Sheet

    for name in ("matplotlib", "fontTools"):  # --debug is for this project's lines
        logging.getLogger(name).setLevel(logging.WARNING)
    with applied():
        sheet = Sheet(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(sheet)
        axes = sheet.subplots(rows, columns, **options)
    return sheet, axes


# How each is saved: without what it would say of its making. PNGs are pressed in half of the time
# that zlib takes by default, and a fifth larger.
FORMATS: dict[str, dict[str, Any]] = {
    "png": {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 3}},
    "svg": {"metadata": {"Date": None, "Creator": None}},
    "pdf": {"metadata": {"CreationDate": None, "Creator": None, "Producer": None}},
}


def saved(sheet: Any, pixels: int = PIXELS) -> SavedSheet:
    """The finished sheet; as PNG it has `pixels` per inch."""
    with applied():
        _placed(sheet, pixels)
    return SavedSheet(sheet, pixels)


def inline(figure: Figure) -> Markup:
    """The SVG as an element of a page that has style.css: its colours follow the reader's theme.

    Properties are attributes, since a page may forbid styles (Content-Security-Policy), and ids
    begin with the figure's name, since a page has several figures.
    """
    svg = figure.files["svg"].decode()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*? width="[^"]*") height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r' style="([^"]*)"', lambda style: _attributes(style[1]), svg)
    svg = re.sub(r'\bid="|(?<=href="#)|(?<=url\(#)', lambda at: f"{at[0]}{figure.name}-", svg)
    head = f'<svg class="chart" role="img" aria-label="{escape(figure.alt)}"'
    return Markup(svg.replace("<svg", head, 1))


def _attributes(style: str) -> str:
    pairs = (rule.split(": ", 1) for rule in style.split("; ") if ": " in rule)
    return "".join(
        f' {name}="{f"var(--{known})" if (known := _VARIABLES.get(value)) else value}"'
        for name, value in pairs
    )


def _placed(sheet: Any, pixels: int) -> None:
    """Find the places of axes once; `savefig` would draw all of it for that, for each format."""
    sheet.set_dpi(pixels)
    sheet.get_layout_engine().execute(sheet)
    sheet.set_layout_engine(None)


def shortened(text: str, most: int) -> str:
    """At most so many letters; a longer text ends behind a word and with an ellipsis."""
    if len(text) <= most:
        return text
    cut = text[: most - 1]
    if not text[most - 1].isspace() and " " in cut[most // 3 :]:
        cut = cut.rpartition(" ")[0]
    return cut.rstrip(" ,;:.–-") + "…"


def readable(text: str) -> str:
    """A label of the data's own words: one short line."""
    return printable(shortened(" ".join(text.split()), _LONGEST))


def printable(text: str) -> str:
    """The text with "?" for letters that the font lacks."""
    known = _letters()
    return "".join(letter if ord(letter) in known else "?" for letter in text)


@functools.cache
def _letters() -> frozenset[int]:
    from matplotlib.font_manager import FontProperties, findfont, get_font

    return frozenset(get_font(findfont(FontProperties(family=FONT))).get_charmap())


def number(n: float) -> str:
    """1,234 as it is, 12,345 as 12.3k, 2,200,000 as 2.2M."""
    for limit, sign in ((1e9, "B"), (1e6, "M"), (1e4, "k")):
        if abs(n) >= limit:
            short = n / (1e3 if sign == "k" else limit)
            return f"{short:.1f}".rstrip("0").rstrip(".") + sign
    return f"{n:,.0f}" if float(n).is_integer() else f"{n:,.1f}"


def counts(axis: Any) -> None:
    """Whole numbers on a count axis: 1, 2 or 5 times a power of ten apart."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis.set_major_locator(MaxNLocator(nbins=6, integer=True, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))


def powers(axis: Any) -> None:
    """1, 10, 100, 1k … on a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axis.set_major_formatter(
        FuncFormatter(lambda value, _: "1k" if value == 1000 else number(value))
    )
    axis.set_minor_formatter(NullFormatter())
