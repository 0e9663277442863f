"""Renders the templates of a release's files, with the filters that write data into them.

Nothing is escaped by default, as Markdown, YAML and BibTeX differ: a template names the filter.

| `md`     | data in Markdown: no markup, no line of its own   |
| `cell`   | our own prose in a Markdown table                 |
| `line`   | data in plain text: one line                      |
| `yaml`   | data in YAML, always quoted                       |
| `bib`    | data in a BibTeX field                            |
| `flow`   | a block of the template as one line               |
| `feature`| a column in a dataset card's front matter         |

Sentences on each source (how it is collected, what it lacks, whom it concerns) are templates too,
in templates/about/: they fit any domain, and the profile adds its own.
"""

import functools
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from kb.core import terminal
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.templates import environment
from kb.release.metadata.measure import Facts, Way
from kb.schema import Column

SANDBOX_NOTE = (
    "Made with the sandbox's tiny toxicity model, whose scores mean nothing about real texts: "
    "for trying the software only, not for publication."
)
UNSCORED_NOTE = "Toxicity: not scored. No text was scored, and none was left out for its toxicity."
# What ends a line, moves a cursor or turns the direction of what follows.
_UNSEEN = re.compile(r"[\s\x00-\x1f\x7f-\x9f\u2028\u2029\u200e\u200f\u202a-\u202e\u2066-\u2069]+")
# An underscore inside a word is no markup: game_label stays as it is.
_MARKUP = re.compile(r"[\\`*\[\]|<>&~$]|(?<![0-9A-Za-z])_|_(?![0-9A-Za-z])|^[-+#=]")
_IN_CELL = re.compile(r"(`[^`]*`)|<")
_BIBTEX = {"\\": r"\textbackslash{}", **{sign: f"\\{sign}" for sign in "{}&%$#_"}}


def day(moment: datetime) -> str:
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


def feature(column: Column) -> str:
    """A column as Hugging Face describes it, in YAML."""
    described = {"name": column.name, **column.parsed.hugging_face()}
    return json.dumps(described, ensure_ascii=False)


def notes(facts: Facts) -> list[str]:
    """What must stand on the first screen of a card, and in the metadata."""
    return [SANDBOX_NOTE] * facts.sandbox + [UNSCORED_NOTE] * facts.unscored


def language(run: Run) -> str:
    """Language of the material, which the profile names: ISO 639, two letters or three."""
    return run.profile.language


def name(run: Run, facts: Facts) -> str:
    """A short name without spaces: lorecrawl-minecraft-youtube."""
    return dataset_name(run.profile, facts.name)


def dataset_name(profile: Profile, source: str) -> str:
    return f"lorecrawl-{profile.name}-{source}"


TEMPLATES = Path(__file__).parents[1] / "templates"
FILTERS = {
    "bib": bib,
    "cell": cell,
    "commas": lambda n: f"{n:,}",
    "day": day,
    "feature": feature,
    "figure": value,
    "flow": line,
    "line": line,
    "md": md,
    "size": terminal.size,
    "span": span,
    "yaml": folded,
}
ENVIRONMENT = environment(TEMPLATES, FILTERS, autoescape=False)
_compiled = functools.cache(ENVIRONMENT.from_string)  # each sentence stands in several files


def render(name: str, **values: Any) -> str:
    """The template of that name, filled. Raises jinja2.UndefinedError for a missing value."""
    return ENVIRONMENT.get_template(f"{name}.jinja").render(values)


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One source in sentences: for card, datasheet, Croissant's RAI part and the deposit.

    `joins` are queries over this folder and others, `kinds` Croissant's types of collection,
    `origins` the recorded ways with shares and dates.
    """

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
    joins: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()


class AboutWay(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What follows from one way by which rows came: [ways.<name>] of a source's sentences. `label`
    is its name where rows are counted.
    """

    collection: str
    kind: str
    label: str = ""
    biases: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    upkeep: str = ""


def about(profile: Profile, facts: Facts, show: Callable[[str], str] = line) -> About:
    """The sentences on a folder, each in one line: those that are true of any domain, what follows
    from the recorded ways, then the profile's own. `show` writes the profile's words, such as `md`
    for Markdown.
    """
    values = {
        "topic": show(profile.title),
        "scored": not facts.unscored,
        "profile": profile,
        "ways": {way.name for way in facts.ways},
    }
    neutral = msgspec.convert(_rendered(sentences_on(facts.source), values), About)
    ways = [
        msgspec.convert(
            _rendered(sentences_on(way.source)["ways"][way.name], values | _rows_of(way)), AboutWay
        )
        for way in facts.ways
    ]
    own = profile.release
    return msgspec.structs.replace(
        neutral,
        collection=line(" ".join([neutral.collection, *(way.collection for way in ways)])),
        origins=tuple(line(way.label) for way in ways if way.label),
        kinds=tuple(dict.fromkeys([*(way.kind for way in ways), *neutral.kinds])),
        upkeep=line(" ".join([neutral.upkeep, *(way.upkeep for way in ways)])),
        biases=(*neutral.biases, *_of(ways, "biases"), *map(show, own.biases)),
        limits=(*neutral.limits, *_of(ways, "limits"), *map(show, own.limits)),
        uses=(*neutral.uses, *map(show, own.uses)),
        avoid=(*neutral.avoid, *map(show, own.avoid)),
    )


def _of(ways: Iterable[AboutWay], name: str) -> list[str]:
    return list(dict.fromkeys(sentence for way in ways for sentence in getattr(way, name)))


def _rows_of(way: Way) -> dict[str, Any]:
    """What the sentences of a way may name: `rows` that came so, and when they were `read`."""
    parts = [
        f"all {total:,} {table}" if n == total else f"{n:,} of {total:,} {table} ({n / total:.1%})"
        for table, n, total in way.counts
    ]
    return {
        "rows": " and ".join(parts),
        "read": span(way.read) if way.read else "",
        "undated": f"{way.undated:,}" if way.undated else "",
    }


@functools.cache
def sentences_on(source: str) -> dict[str, Any]:
    """The sentences on a folder, not filled yet."""
    path = TEMPLATES / "about" / f"{source}.toml"
    if not path.is_file():  # a source may bring its own
        path = SOURCES[source].package / "about.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _rendered(sentences: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Every sentence filled, in one line; a list leaves out those that come to nothing."""

    def fill(text: str) -> str:
        return line(_compiled(text).render(values))

    return {
        name: fill(text)
        if isinstance(text, str)
        else [filled for entry in text if (filled := fill(entry))]
        for name, text in sentences.items()
        if name != "ways"
    }
