"""Small pieces of text that several of a release's files share: sizes, dates, tables, citation."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from kb.core.context import Run
    from kb.release.measure import Facts

SANDBOX_NOTE = "Made with the sandbox's tiny toxicity model, whose scores mean nothing about real texts: for trying the software only, not for publication."


def day(moment: datetime) -> str:
    """2026-11-20."""
    return moment.strftime("%Y-%m-%d")


def span(pair: tuple[datetime, datetime] | None) -> str:
    """Two dates as a sentence's part."""
    if pair is None:
        return "unknown"
    first, last = day(pair[0]), day(pair[1])
    return first if first == last else f"{first} to {last}"


def size(n: int) -> str:
    """Bytes for people: 1.2 MB."""
    for unit, step in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if n >= step:
            return f"{n / step:.1f} {unit}"
    return f"{n} B"


def value(thing: Any) -> str:
    """A figure for people."""
    if thing is None:
        return ""
    if isinstance(thing, datetime):
        return day(thing)
    if isinstance(thing, float):
        return f"{thing:,.3g}" if abs(thing) < 1000 else f"{thing:,.0f}"
    return f"{thing:,}" if isinstance(thing, int) and not isinstance(thing, bool) else str(thing)


def rows(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A Markdown table; bars in cells are escaped."""
    cells = [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines]
    return (
        "\n".join(
            ["| " + " | ".join(line) + " |" for line in [list(head), ["---"] * len(head), *cells]]
        )
        + "\n"
    )


def folded(text: str) -> str:
    """A string for YAML, always quoted."""
    import json

    return json.dumps(text, ensure_ascii=False)


def title(run: Run, facts: Facts) -> str:
    """The folder's title, with the domain's name."""
    from kb.release.about import ABOUT

    return ABOUT[facts.source].on(run.profile.title, ABOUT[facts.source].title)


def summary(run: Run, facts: Facts) -> str:
    """The folder's summary in a sentence or two."""
    from kb.release.about import ABOUT

    return ABOUT[facts.source].on(run.profile.title, ABOUT[facts.source].summary)


def language(run: Run) -> str:
    """Language of the material as the profile gives it: ISO 639, two letters or three."""
    return run.profile.youtube.language if run.profile.youtube else "en"


def name(run: Run, facts: Facts) -> str:
    """A short name without spaces: lorebase-minecraft-youtube."""
    return f"lorebase-{run.profile.name}-{facts.source}"


def bibtex(run: Run, facts: Facts) -> str:
    """How to cite the folder."""
    authors = " and ".join(creator.name for creator in run.profile.release.creators)
    key = name(run, facts).replace("-", "_")
    lines = [
        f"@misc{{{key},",
        f"  title = {{{title(run, facts)}}},",
        f"  author = {{{authors}}},",
        f"  year = {{{facts.built.year}}},",
        f"  version = {{{run.profile.release.version}}},",
        "  note = {Built with Lorebase}",
        "}",
    ]
    return "\n".join(lines)
