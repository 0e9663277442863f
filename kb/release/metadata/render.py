"""Templates: the prose of a release's files, with the data's own words escaped for where they go.

Nothing is escaped by itself, as Markdown, YAML and BibTeX differ: a template names the filter.

| `md`     | data in Markdown: no markup, no line of its own   |
| `cell`   | our own prose in a Markdown table                 |
| `line`   | data in plain text: one line                      |
| `yaml`   | data in YAML, always quoted                       |
| `bib`    | data in a BibTeX field                            |
| `flow`   | a block of the template as one line               |
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kb.core import sizes
from kb.core.templates import environment
from kb.release.metadata import text as texts

TEMPLATES = Path(__file__).parents[1] / "templates"
FILTERS = {
    "bib": texts.bib,
    "cell": texts.cell,
    "commas": lambda n: f"{n:,}",
    "day": texts.day,
    "figure": texts.value,
    "flow": texts.line,
    "line": texts.line,
    "md": texts.md,
    "size": sizes.shown,
    "span": texts.span,
    "yaml": texts.folded,
}
ENVIRONMENT = environment(TEMPLATES, FILTERS, autoescape=False)


def render(name: str, **values: Any) -> str:
    """The template of that name, filled. Raises jinja2.UndefinedError for a missing value."""
    return ENVIRONMENT.get_template(f"{name}.jinja").render(values)
