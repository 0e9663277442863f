"""index.html: one file that needs nothing else. Images and styles are inside, no script."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from markupsafe import Markup

from kb.core.templates import environment
from kb.report.figure_style import Figure, number

_TEMPLATES = Path(__file__).with_name("templates")
_LONGEST = 160  # letters of a cell
_HEAVY = 400_000  # bytes of an SVG


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
    filters = {"address": _address, "cell": _cell, "number": number}
    templates = environment(_TEMPLATES, filters, autoescape=True)
    return templates.get_template("page.html.jinja").render(
        title=title,
        as_of=as_of,
        cards=cards,
        sections=sections,
        notes=notes,
        shows_content=any(section.figures or section.samples for section in sections),
        style=Markup((_TEMPLATES / "style.css").read_text(encoding="utf-8")),
    )


def _address(figure: Figure) -> str:
    """The image inside the page: as SVG, unless a screenshot makes that much the heavier."""
    svg, png = figure.files["svg"], figure.files["png"]
    if len(svg) > _HEAVY and len(svg) > 2 * len(png):
        return f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"


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
