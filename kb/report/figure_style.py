"""How every figure looks, and how it is saved: the same bytes for the same data.

Colours: Okabe and Ito's palette, told apart with any colour vision and on paper. Figures are as
wide as a phone's screen in points, so that their labels stay readable on one.
"""

import contextlib
import functools
import io
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

BLUE, ORANGE, GREEN, RED, SKY, PURPLE = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#56B4E9",
    "#CC79A7",
)
INK, GREY, PALE = "#1F2933", "#52606D", "#D9E2EC"
FONT = "DejaVu Sans"  # comes with matplotlib: the same letters everywhere
WIDTH = 4.6  # inches
PIXELS = 200  # per inch, of the PNG
_LONGEST = 26  # letters of a label
# What a font in a PDF needs (ISO 32000-1, 9.9): outlines, widths, hints.
_IN_PDF = {"glyf", "head", "hhea", "hmtx", "loca", "maxp", "cvt ", "fpgm", "prep"}
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


@dataclass(frozen=True)
class Figure:
    """One finished figure. `rows` are the numbers behind it, for those who can't see it."""

    name: str
    title: str
    caption: str
    alt: str
    files: dict[str, bytes]  # by suffix: svg, png, pdf
    head: Sequence[str] = ()
    rows: Sequence[Sequence[object]] = ()
    screen: bool = False  # shows a screen: beside its like, and not enlarged


def applied() -> Any:
    """A context in which whatever is drawn looks like the rest."""
    import matplotlib

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


# And what each would say of its making.
FORMATS: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def saved(sheet: Any, pixels: int = PIXELS) -> dict[str, bytes]:
    """The figure as PNG (`pixels` per inch), SVG and PDF, without dates or version names."""
    files = {}
    with applied(), _letters_alone():
        _placed(sheet, pixels)
        for kind, metadata in FORMATS.items():
            file = io.BytesIO()
            sheet.savefig(file, format=kind, dpi=pixels, metadata=metadata)
            files[kind] = file.getvalue()
    return files


def _placed(sheet: Any, pixels: int) -> None:
    """Find the places of axes once; `savefig` would draw all of it for that, for each format."""
    sheet.set_dpi(pixels)
    sheet.get_layout_engine().execute(sheet)
    sheet.set_layout_engine(None)


@contextlib.contextmanager
def _letters_alone() -> Iterator[None]:
    """The fonts of PDFs are outlines and widths alone, whatever else their files hold.

    matplotlib has no setting for it: for each figure it would cut down tables for the placing and
    naming of letters, which takes most of the time of a PDF, and which no reader of one asks for.
    """
    from fontTools import subset

    load = subset.load_font

    def bare(*args: Any, **options: Any) -> Any:
        font = load(*args, **options)
        for tag in set(font.keys()) - _IN_PDF - {"GlyphOrder"}:
            del font[tag]
        return font

    subset.load_font = bare
    try:
        yield
    finally:
        subset.load_font = load


def readable(text: str) -> str:
    """A label of the data's own words: one short line, "?" for letters that the font lacks."""
    line = " ".join(text.split())
    short = line if len(line) <= _LONGEST else line[: _LONGEST - 1].rstrip() + "…"
    known = _letters()
    return "".join(letter if ord(letter) in known else "?" for letter in short)


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
    """Readable whole numbers on a count axis."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))


def powers(axis: Any) -> None:
    """1, 10, 100, 1k … on a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axis.set_major_formatter(
        FuncFormatter(lambda value, _: "1k" if value == 1000 else number(value))
    )
    axis.set_minor_formatter(NullFormatter())
