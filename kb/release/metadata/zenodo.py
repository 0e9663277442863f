"""zenodo.json: the deposit's metadata, as a model of our own of Zenodo's documented fields.

Source: https://developers.zenodo.org, "Deposit metadata". A deposit without a licence silently
becomes CC0 there, so `license` has no default here. Codes of languages are those of ISO 639-2
(terminological), https://www.loc.gov/standards/iso639-2/.
"""

import html
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from kb.core import terminal
from kb.core.config.profile.release import Release
from kb.core.context import Run
from kb.core.installation import software_address
from kb.core.languages import three_letters
from kb.core.licences import licence
from kb.core.sources import SOURCES, made_of
from kb.release.metadata.measure import Facts
from kb.release.metadata.templates import about, day, language, name, notes, span

PAPER = "arXiv:2206.08853"  # "MineDojo: Building Open-Ended Embodied Agents …", NeurIPS 2022
_ARTICLE: Literal["publication-article"] = "publication-article"

Text = Annotated[str, Field(min_length=1)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)


class DepositCreator(_Part):
    """Who made the data set."""

    name: Text
    affiliation: Text | None = None
    orcid: Text | None = None


class Related(_Part):
    """Another resource and how this one relates to it."""

    identifier: Text
    relation: Literal[
        "isSupplementTo",
        "isDerivedFrom",
        "isPartOf",
        "isDocumentedBy",
        "isNewVersionOf",
        "references",
        "isCompiledBy",
    ]
    resource_type: Literal["dataset", "software", "publication-article", "other"] = "other"


class Community(_Part):
    """A Zenodo community that the deposit is offered to."""

    identifier: Text


class DepositMetadata(_Part):
    """The fields of a deposit that Lorecrawl sets."""

    upload_type: Literal["dataset"] = "dataset"
    title: Text
    description: Text
    creators: tuple[DepositCreator, ...] = Field(min_length=1)
    publication_date: str | None = Field(None, pattern=r"^\d{4}-\d{2}-\d{2}$")
    access_right: Literal["open"] = "open"
    license: Text
    version: str = Field(pattern=r"^\d+\.\d+\.\d+$")
    language: str | None = Field(None, pattern=r"^[a-z]{3}$")
    keywords: tuple[Text, ...] = ()
    notes: Text | None = None
    communities: tuple[Community, ...] | None = None
    related_identifiers: tuple[Related, ...] | None = None


class Document(_Part):
    """zenodo.json: what is sent, and what Lorecrawl needs to know about the folder to send it."""

    name: Text
    sandbox_model: bool
    metadata: DepositMetadata


def deposit(run: Run, facts: Facts) -> str:
    """zenodo.json as text."""
    section, prose = run.profile.release, about(run.profile, facts)
    metadata = DepositMetadata(
        title=prose.title,
        description=_description(run, facts),
        creators=tuple(
            DepositCreator(name=creator.name, affiliation=creator.affiliation, orcid=creator.orcid)
            for creator in section.creators
        ),
        publication_date=day(facts.built) if facts.built else None,
        license=licence(facts.licence).zenodo,
        version=section.version,
        language=three_letters(language(run)),
        keywords=tuple(dict.fromkeys((run.profile.title, *prose.words, *section.keywords))),
        notes=" ".join(notes(facts)) or None,
        communities=tuple(Community(identifier=community) for community in section.communities)
        or None,
        related_identifiers=_related(section, facts.source),
    )
    return (
        Document(
            name=name(run, facts), sandbox_model=facts.sandbox, metadata=metadata
        ).model_dump_json(indent=2, exclude_none=True)
        + "\n"
    )


def _related(section: Release, source: str) -> tuple[Related, ...]:
    """The project's page, the software, the other folders whose DOI is known (which these rows were
    made of, or which supplement them), and the paper whose data set is made anew.
    """
    related = [Related(identifier=PAPER, relation="references", resource_type=_ARTICLE)]
    for other, published in section.published.items():
        if published.doi and other != source:
            made = source not in SOURCES and other in made_of(source)
            related.append(
                Related(
                    identifier=published.doi,
                    relation="isDerivedFrom" if made else "isSupplementTo",
                    resource_type="dataset",
                )
            )
    if section.homepage:
        related.append(Related(identifier=section.homepage, relation="isDocumentedBy"))
    if address := software_address():
        related.append(
            Related(identifier=address, relation="isCompiledBy", resource_type="software")
        )
    return tuple(related)


def _description(run: Run, facts: Facts) -> str:
    """HTML, as Zenodo shows it."""
    prose = about(run.profile, facts)
    tables = "".join(
        (
            f"<li><b>{html.escape(table.table.short)}</b>:"
            f" {html.escape(table.table.doc)} {table.rows:,} rows,"
            f" {terminal.size(table.size)}.</li>"
        )
        for table in facts.tables
    )
    sentences = [
        prose.summary,
        prose.collection,
        f"Read from the source {span(facts.read)}"
        + (f"; material from {span(facts.made)}." if facts.made else "."),
        f"{prose.attribution} {licence(facts.licence).short}",
    ]
    return (
        "".join(f"<p>{html.escape(line)}</p>" for line in sentences[:2])
        + f"<ul>{tables}</ul>"
        + "".join(f"<p>{html.escape(line)}</p>" for line in sentences[2:])
    )
