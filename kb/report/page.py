"""index.html: one file that needs nothing else. Pictures and styles are inside, no script, no network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from kb.report.style import Figure, number

_STYLE = """
:root { --ink: #1f2933; --soft: #52606d; --line: #d9e2ec; --card: #ffffff; --back: #f5f7fa; --accent: #005a8d; }
* { box-sizing: border-box; }
body { margin: 0; font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; color: var(--ink);
  background: var(--back); overflow-wrap: anywhere; }
main, header, footer { max-width: 1180px; margin: 0 auto; padding: 0 16px; }
header { padding-top: 28px; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 4px; }
h2 { font-size: 1.3rem; margin: 36px 0 12px; padding-top: 8px; border-top: 3px solid var(--accent); }
h3 { font-size: 1.02rem; margin: 0 0 8px; }
p { margin: 0 0 12px; }
.soft, figcaption, footer { color: var(--soft); }
nav a { display: inline-block; margin: 8px 16px 0 0; padding: 6px 0; color: var(--accent); }
.cards { display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); margin: 20px 0; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 12px 14px; }
.card b { display: block; font-size: 1.5rem; line-height: 1.2; }
.figures { display: grid; gap: 16px; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 480px), 1fr)); }
figure { margin: 0; background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 14px; }
figure img { display: block; width: 100%; height: auto; }
figcaption { font-size: 0.9rem; margin-top: 8px; }
.missing { background: #fff7e0; border-left: 4px solid #e69f00; padding: 10px 14px; border-radius: 0 8px 8px 0; }
.wide { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  margin-top: 16px; }
table { border-collapse: collapse; width: 100%; font-size: 0.88rem; }
caption { text-align: left; font-weight: 600; padding: 12px 14px 4px; }
th, td { text-align: left; padding: 6px 14px; border-bottom: 1px solid var(--line); vertical-align: top;
  overflow-wrap: normal; }
td.text { min-width: 16em; }
td.n { text-align: right; font-variant-numeric: tabular-nums; }
details { margin-top: 8px; font-size: 0.88rem; }
summary { cursor: pointer; color: var(--accent); padding: 4px 0; }
details .wide { max-height: 22em; overflow: auto; margin-top: 4px; }
footer { padding: 28px 16px 40px; font-size: 0.9rem; }
@media (max-width: 520px) {
  main, header, footer { padding-left: 10px; padding-right: 10px; }
  figure { padding: 10px 8px; }
}
@media print { details, nav { display: none; } figure { break-inside: avoid; } }
"""


@dataclass
class Section:
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
    sections: Sequence[Section],
    notes: Sequence[str],
) -> str:
    """The whole document. `cards` are (what, number, remark)."""
    parts = [
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        (
            "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">"
        ),
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>",
        f"<header>\n<h1>{escape(title)}</h1>",
        f'<p class="soft">{escape(f"Data as of {as_of}." if as_of else "No data yet.")}</p>',
        "<nav>"
        + "".join(f'<a href="#{section.id}">{escape(section.title)}</a>' for section in sections)
        + "</nav>\n</header>\n<main>",
    ]
    if cards:
        parts.append(
            '<div class="cards">'
            + "".join(
                f'<div class="card"><b>{number(n)}</b>{escape(what)}<br><span class="soft">{escape(remark)}</span></div>'
                for what, n, remark in cards
            )
            + "</div>"
        )
    parts += [f'<p class="missing">{escape(note)}</p>' for note in notes]
    parts += [_section(section) for section in sections]
    parts.append(
        "</main>\n<footer>Made by <code>kb report</code>. Each figure is beside this page as SVG and PNG.</footer>\n</body>\n</html>\n"
    )
    return "\n".join(parts)


def _section(section: Section) -> str:
    parts = [f'<section id="{section.id}">\n<h2>{escape(section.title)}</h2>']
    parts += [f'<p class="missing">{escape(line)}</p>' for line in section.missing]
    if section.figures:
        parts.append(
            '<div class="figures">'
            + "\n".join(_figure(figure) for figure in section.figures)
            + "</div>"
        )
    parts += [_table(title, head, rows) for title, head, rows in section.samples]
    return "\n".join([*parts, "</section>"])


def _figure(figure: Figure) -> str:
    # A screenshot inside an SVG weighs more than the picture itself.
    kind, data = (
        ("image/png", figure.png)
        if len(figure.svg) > 2 * len(figure.png) and len(figure.svg) > 400_000
        else ("image/svg+xml", figure.svg)
    )
    source = f"data:{kind};base64,{base64.b64encode(data).decode()}"
    numbers = (
        f"<details><summary>The numbers</summary>{_table('', figure.head, figure.rows)}</details>"
        if figure.rows
        else ""
    )
    picture = f'<img src="{source}" alt="{escape(figure.alt, quote=True)}">'
    caption = f"<figcaption>{escape(figure.caption)}</figcaption>"
    return f'<figure id="{figure.name}"><h3>{escape(figure.title)}</h3>{picture}{caption}{numbers}</figure>'


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    top = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    body = "".join("<tr>" + "".join(_cell(value) for value in row) + "</tr>\n" for row in rows)
    table = f"<table>{caption}<thead><tr>{top}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f'<div class="wide" tabindex="0">{table}</div>'


def _cell(value: object) -> str:
    if value is None:
        return '<td class="soft">none</td>'
    if isinstance(value, bool):
        return f"<td>{'yes' if value else 'no'}</td>"
    if isinstance(value, (int, float)):
        return (
            f'<td class="n">{value:,}</td>'
            if isinstance(value, int)
            else f'<td class="n">{value:,.2f}</td>'
        )
    text = str(value)
    return f"<td{' class=text' if len(text) > 24 else ''}>{escape(text if len(text) <= 160 else text[:157] + '…')}</td>"
