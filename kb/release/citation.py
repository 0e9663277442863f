"""CITATION.cff, version 1.2.0 of the Citation File Format (https://citation-file-format.github.io)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.release.about import ABOUT
from kb.release.texts import day, folded, summary, title

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.release.measure import Facts


def citation(run: Run, facts: Facts) -> str:
    """The whole file. Strings are quoted as JSON, which YAML reads."""
    section = run.profile.release
    lines = [
        "cff-version: 1.2.0",
        "message: If you use this data set, please cite it as below.",
        "type: dataset",
        f"title: {folded(title(run, facts))}",
        f"abstract: {folded(summary(run, facts))}",
        f"version: {folded(section.version)}",
        f"date-released: {day(facts.built)}",
        f"license: {facts.licence}",
    ]
    if section.homepage:
        lines.append(f"url: {folded(section.homepage)}")
    lines += [
        "keywords:",
        *[
            f"  - {folded(word)}"
            for word in dict.fromkeys(
                (run.profile.name, *ABOUT[facts.source].words, *section.keywords)
            )
        ],
        "authors:",
    ]
    for creator in section.creators:
        family, comma, given = creator.name.partition(",")
        if comma:
            lines += [
                f"  - family-names: {folded(family.strip())}",
                f"    given-names: {folded(given.strip())}",
            ]
            lines += (
                [f"    affiliation: {folded(creator.affiliation)}"] if creator.affiliation else []
            )
        else:
            lines.append(f"  - name: {folded(creator.name)}")
        lines += (
            [f"    orcid: {folded('https://orcid.org/' + creator.orcid)}"] if creator.orcid else []
        )
    return "\n".join(lines) + "\n"
