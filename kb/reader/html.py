"""Small pieces of HTML for notebooks. Everything from the data is escaped here."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any
from urllib.parse import urlsplit

from kb.query.formats import for_display

_CELL = 80  # characters of a value that are shown


def text(value: Any, limit: int = _CELL) -> str:
    """A value in one line, cut to `limit` characters and escaped; empty for None."""
    if value is None:
        return ""
    line = for_display(value)
    return escape(line if len(line) <= limit else line[: limit - 1].rstrip() + "…")


def link(url: str | None, words: Any) -> str:
    """A link with these words; only the words if the URL is not a web address."""
    if not url or urlsplit(url).scheme not in ("http", "https"):
        return text(words)
    return f'<a href="{escape(url)}" rel="noreferrer">{text(words)}</a>'


def rows(columns: Sequence[str], values: Iterable[Sequence[Any]], caption: str = "") -> str:
    """A table of values, which scrolls sideways if it is wide."""
    head = "".join(f"<th>{text(name)}</th>" for name in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{text(value)}</td>" for value in row) + "</tr>" for row in values
    )
    return block(
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>",
        caption=escape(caption),
    )


def block(inner: str, *, caption: str = "") -> str:
    """A block with a caption above it. Both are HTML already."""
    above = f"<div><small>{caption}</small></div>" if caption else ""
    return f'<div style="overflow-x:auto">{above}{inner}</div>'


def count(number: int, noun: str) -> str:
    """ "1 row", "2,017 rows"."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
