"""The files that people read beside the data, each from its template in templates/.

card        README.md, with the front matter that Hugging Face's loader and hub read
            ("Dataset Cards", "Manual configuration" in the hub's documentation)
datasheet   DATASHEET.md: the questions of "Datasheets for Datasets" (Gebru et al., 2021)
citation    CITATION.cff, version 1.2.0 (https://citation-file-format.github.io)
law         LICENSE: whose the data is, then the legal text

Figures come from kb.release.metadata.measure, sentences on a source from
kb.release.metadata.templates.


The first screen of a card says how to get the content and shows one picture as text, as a card is
read in many places: a bar for each filter stage, or for the most frequent keywords.
"""

from typing import Any

from kb.core.context import Run
from kb.core.installation import install_extra, lock_digest, software_address
from kb.core.licences import licence
from kb.core.sources import PUBLISHED, SourceDeclaration
from kb.core.summary import remaining
from kb.release import provenance
from kb.release.metadata.measure import Facts, TableFacts
from kb.release.metadata.templates import about, language, md, name, notes, render
from kb.release.provenance import Changes
from kb.version import __version__

WIDTH = 40  # of the longest bar, in characters


def picture(facts: Facts) -> list[tuple[str, int, str]]:
    """Lines with a name, a number and a bar: how much each stage left over, or how often the most
    frequent keywords are met.
    """
    of = PUBLISHED[facts.source]
    if isinstance(of, SourceDeclaration) and of.stages:
        return _bars(_funnel(facts, of))
    main = [
        column for part in facts.tables if part.table.short == of.main for column in part.columns
    ]
    return _bars([value for fact in main if fact.column.name == of.pictured for value in fact.top])


def _funnel(facts: Facts, source: SourceDeclaration) -> list[tuple[str, int]]:
    """What was crawled, then what was left behind each stage that dropped something."""
    dropped: dict[str, int] = {}
    for stage, _, n in facts.rejected:
        dropped[stage] = dropped.get(stage, 0) + n
    left = sum(part.rows for part in facts.tables if part.table.short in source.tables)
    left += sum(dropped.values()) + facts.failed + facts.pending
    stages = [(f"after {stage}", dropped[stage]) for stage in source.stages if stage in dropped]
    ends = (("failed", facts.failed), ("pending", facts.pending))
    stages += [(f"without {n:,} {end}", n) for end, n in ends if n]
    (_, read, _), *steps = remaining(left, stages)
    return [("read", read), *((step, left) for step, left, _ in steps)]


def _bars(steps: list[tuple[str, int]]) -> list[tuple[str, int, str]]:
    most = max((n for _, n in steps), default=0)
    return [(name, n, "█" * max(1, round(WIDTH * n / most))) for name, n in steps if n]


# The hub's size categories, a power of ten each.
SIZES = (
    *("n<1K", "1K<n<10K", "10K<n<100K", "100K<n<1M", "1M<n<10M", "10M<n<100M", "100M<n<1B"),
    *("1B<n<10B", "10B<n<100B", "100B<n<1T", "n>1T"),
)


def size_category(rows: int) -> str:
    return SIZES[min(max(len(str(rows)) - 3, 0), len(SIZES) - 1)]


def card(run: Run, facts: Facts, changed: Changes) -> str:
    """The dataset card."""
    stages: dict[str, int] = {}
    for stage, _, n in facts.rejected:
        stages[stage] = stages.get(stage, 0) + n
    return render(
        "card.md",
        **_in_markdown(run, facts),
        title=about(run.profile, facts).title,
        language=language(run),
        size_category=size_category(facts.rows),
        tags=_search_words(run, facts),
        main=next((table for table in facts.tables if _is_main(table)), facts.tables[0]),
        stages=sorted(stages.items(), key=lambda item: (-item[1], item[0])),
        bibtex=bibtex(run, facts),
        first={  # what templates/first_screen.md.jinja says
            "query": PUBLISHED[facts.source].query,
            "restored": PUBLISHED[facts.source].restored,
            "restored_query": PUBLISHED[facts.source].restored_query,
            "archive": next(
                (file.name for file in facts.others if file.name.endswith(".tar")), None
            ),
            "picture": picture(facts),
        },
        changed=changed,
        rules=provenance.rules(run.profile, facts.source),
        profile=run.profile,
        listed=bool(provenance.keyword_text(run.profile)),
    )


def datasheet(run: Run, facts: Facts) -> str:
    return render(
        "datasheet.md",
        **_in_markdown(run, facts),
        kept=next((table.rows for table in facts.tables if _is_main(table)), facts.rows),
        rejected=sum(n for _, _, n in facts.rejected),
        toxic=sum(n for stage, _, n in facts.rejected if stage == "toxicity"),
        toxicity=run.profile.toxicity,
    )


def citation(run: Run, facts: Facts) -> str:
    """CITATION.cff. Strings are quoted as JSON, which YAML reads."""
    return render(
        "citation.cff",
        version=__version__,
        address=software_address(),
        lock=lock_digest(),
        about=about(run.profile, facts),
        facts=facts,
        published=run.profile.release.published_at(facts.source),
        release=run.profile.release,
        words=_search_words(run, facts),
    )


def bibtex(run: Run, facts: Facts) -> str:
    """How to cite the folder."""
    return render(
        "citation.bib",
        about=about(run.profile, facts),
        facts=facts,
        key=name(run, facts).replace("-", "_"),
        published=run.profile.release.published_at(facts.source),
        release=run.profile.release,
        version=__version__,
    ).rstrip("\n")


def law(run: Run, facts: Facts) -> str:
    """LICENSE. Names of licences are the wiki's own words, so each stays on its line."""
    return render(
        "licence.txt",
        about=about(run.profile, facts),
        facts=facts,
        law=licence(facts.licence),
    )


def _in_markdown(run: Run, facts: Facts) -> dict[str, Any]:
    section = run.profile.release
    return {
        "about": about(run.profile, facts, md),
        "contact": section.contact or section.homepage or "the depositor of this record",
        "facts": facts,
        "law": licence(facts.licence),
        "notes": notes(facts),
        "install": install_extra(PUBLISHED[facts.source].extra, here=False),
        "release": section,
        "software": _software(),
        "address": software_address(),
        "topic": run.profile.title,
    }


def _search_words(run: Run, facts: Facts) -> list[str]:
    words = about(run.profile, facts).words
    return list(dict.fromkeys((run.profile.name, *words, *run.profile.release.keywords)))


def _is_main(table: TableFacts) -> bool:
    return table.table.short == PUBLISHED[table.table.source].main


def _software() -> str:
    """Name, version, address (where the package declares one) and lock file of this software."""
    facts = [software_address(), f"lock file SHA-256 {digest}" if (digest := lock_digest()) else ""]
    known = ", ".join(fact for fact in facts if fact)
    return f"Lorecrawl {__version__}" + (f" ({known})" if known else "")
