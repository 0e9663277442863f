"""Renders the templates of a release's files, with the filters that write data into them.

Nothing is escaped by default, as Markdown, YAML and BibTeX differ: a template names the filter.

| `md`     | data in Markdown: no markup, no line of its own   |
| `cell`   | our own prose in a Markdown table                 |
| `line`   | data in plain text: one line                      |
| `yaml`   | data in YAML, always quoted                       |
| `bib`    | data in a BibTeX field                            |
| `flow`   | a block of the template as one line               |

Sentences on each source (how it is collected, what it lacks, whom it concerns) are templates too,
in templates/about/: they fit any domain, and the profile adds its own.
"""

import functools
import json
import re
import tomllib
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from kb.core import terminal
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.templates import environment
from kb.release.metadata.measure import Facts

SANDBOX_NOTE = (
    "Made with the sandbox's tiny toxicity model, whose scores mean nothing about real texts: "
    "for trying the software only, not for publication."
)
# What ends a line, moves a cursor or turns the direction of what follows.
_UNSEEN = re.compile(r"[\s\x00-\x1f\x7f-\x9f\u2028\u2029\u200e\u200f\u202a-\u202e\u2066-\u2069]+")
# An underscore inside a word is no markup: game_label stays as it is.
_MARKUP = re.compile(r"[\\`*\[\]|<>&~$]|(?<![0-9A-Za-z])_|_(?![0-9A-Za-z])|^[-+#=]")
_IN_CELL = re.compile(r"(`[^`]*`)|<")
_BIBTEX = {"\\": r"\textbackslash{}", **{sign: f"\\{sign}" for sign in "{}&%$#_"}}


def day(moment: datetime) -> str:
    """2026-11-20."""
    return moment.strftime("%Y-%m-%d")


def span(pair: tuple[datetime, datetime] | None) -> str:
    """Two dates as a sentence's part."""
    if pair is None:
        return "unknown"
    first, last = day(pair[0]), day(pair[1])
    return first if first == last else f"{first} to {last}"


def value(thing: Any) -> str:
    """A figure for people."""
    if thing is None:
        return ""
    if isinstance(thing, datetime):
        return day(thing)
    if isinstance(thing, float):
        return f"{thing:,.3g}" if abs(thing) < 1000 else f"{thing:,.0f}"
    return f"{thing:,}" if isinstance(thing, int) and not isinstance(thing, bool) else str(thing)


def line(text: object) -> str:
    """A text as one line: every run of blanks, line ends and control characters is one blank."""
    return _UNSEEN.sub(" ", str(text)).strip()


def md(text: object) -> str:
    """Data in Markdown, in running text or a table's cell: shown as it is, never read as markup."""
    return _MARKUP.sub(r"\\\g<0>", line(text))


def cell(text: object) -> str:
    """Prose of our own in the cell of a Markdown table: code stays code, `<tar>` is no tag."""
    return _IN_CELL.sub(lambda match: match[1] or "\\" + match[0], line(text).replace("|", "\\|"))


def bib(text: object) -> str:
    """Data in a field of BibTeX, between braces."""
    return "".join(_BIBTEX.get(sign, sign) for sign in line(text))


def folded(text: str) -> str:
    """A string for YAML, always quoted."""
    return json.dumps(text, ensure_ascii=False)


def language(run: Run) -> str:
    """Language of the material as the profile gives it: ISO 639, two letters or three."""
    return run.profile.youtube.language if run.profile.youtube else "en"


def name(run: Run, facts: Facts) -> str:
    """A short name without spaces: lorecrawl-minecraft-youtube."""
    return dataset_name(run.profile, facts.source)


def dataset_name(profile: Profile, source: str) -> str:
    """The same of any release folder."""
    return f"lorecrawl-{profile.name}-{source}"


TEMPLATES = Path(__file__).parents[1] / "templates"
FILTERS = {
    "bib": bib,
    "cell": cell,
    "commas": lambda n: f"{n:,}",
    "day": day,
    "figure": value,
    "flow": line,
    "line": line,
    "md": md,
    "size": terminal.size,
    "span": span,
    "yaml": folded,
}
ENVIRONMENT = environment(TEMPLATES, FILTERS, autoescape=False)


def render(name: str, **values: Any) -> str:
    """The template of that name, filled. Raises jinja2.UndefinedError for a missing value."""
    return ENVIRONMENT.get_template(f"{name}.jinja").render(values)


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One source in sentences: for card, datasheet, Croissant's RAI part and the deposit."""

    title: str
    summary: str
    instance: str
    collection: str
    processing: tuple[str, ...]
    absent: str
    raw: str
    people: str
    biases: tuple[str, ...]
    limits: tuple[str, ...]
    uses: tuple[str, ...]
    avoid: tuple[str, ...]
    upkeep: str
    words: tuple[str, ...]
    tasks: tuple[str, ...]
    attribution: str


def about(profile: Profile, source: str, show: Callable[[str], str] = line) -> About:
    """The sentences on a source, each in one line: those that are true of any domain, then the
    profile's own. `show` writes the profile's words, such as `md` for Markdown.
    """
    neutral, own = _neutral(source, show(profile.title)), profile.release
    return msgspec.structs.replace(
        neutral,
        biases=(*neutral.biases, *map(show, own.biases)),
        limits=(*neutral.limits, *map(show, own.limits)),
        uses=(*neutral.uses, *map(show, own.uses)),
        avoid=(*neutral.avoid, *map(show, own.avoid)),
    )


@functools.cache
def _neutral(source: str, topic: str) -> About:
    path = TEMPLATES / "about" / f"{source}.toml"
    if not path.is_file():  # a source may bring its own
        path = SOURCES[source].folder / "about.toml"
    sentences = {
        name: _render(text, topic)
        for name, text in tomllib.loads(path.read_text(encoding="utf-8")).items()
    }
    return msgspec.convert(sentences, About)


def _render(text: str | list[str], topic: str) -> str | list[str]:
    if isinstance(text, list):
        return [line(ENVIRONMENT.from_string(one).render(topic=topic)) for one in text]
    return line(ENVIRONMENT.from_string(text).render(topic=topic))
