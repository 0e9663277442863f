"""[release]: what a published data set says about itself, and what its checks tolerate."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import Field, field_validator

from kb.core.config.section import Section
from kb.core.sources import BY_DEFAULT, PUBLISHED, SOURCES


class Creator(Section):
    """A person or group that the citation names."""

    name: str = Field(min_length=1, description="family name, given name; or the group's name")
    affiliation: str | None = Field(None, description="affiliation")
    orcid: str | None = Field(
        None,
        pattern=r"^\d{4}-\d{4}-\d{4}-\d{3}[\dX]$",
        description="ORCID id",
        examples=["0000-0002-1825-0097"],
    )


class PublishedAt(Section):
    """Where a folder is, or will be, published; known once its deposit or repository exists."""

    doi: str | None = Field(
        None,
        pattern=r"^10\.\d{4,9}/\S+$",
        description="DOI of the folder, such as the one that a Zenodo draft reserves",
        examples=["10.5281/zenodo.1234567"],
    )
    files: str | None = Field(
        None,
        pattern=r"^https?://\S+[^\s/]$",
        description="address of the folder's files, without the slash at its end",
        examples=["https://zenodo.org/records/1234567/files"],
    )


class Datasheet(Section):
    """Answers to questions of the datasheet that only the authors know."""

    funding: str | None = Field(None, description="who funded the collection")
    collectors: str | None = Field(
        None, description="who collected the data, and how they were paid for it"
    )
    ethics_review: str | None = Field(
        None, description="reviews by an ethics board, with their outcome"
    )
    impact: str | None = Field(
        None, description="analysis of the impact on people whom the data is about"
    )
    sensitive_data: str | None = Field(
        None, description="what in the data may be sensitive, such as health or beliefs"
    )
    third_parties: str | None = Field(
        None, description="to whom the data is given outside of the authors' organisation"
    )
    third_party_rights: str | None = Field(
        None, description="limits that rights of third parties put on the data"
    )
    export_controls: str | None = Field(
        None, description="export controls and other regulation that applies"
    )
    erratum: str | None = Field(None, description="where corrections are listed")
    contributing: str | None = Field(None, description="how others can extend the data set")
    uses_so_far: str | None = Field(None, description="what the data was used for already")


class Release(Section):
    """The release part of a profile (Zenodo deposit metadata; Datasheets for Datasets)."""

    table = "release"
    about = "Release: what a published data set says about itself"

    version: str = Field(
        "1.0.0",
        pattern=r"^\d+\.\d+\.\d+$",
        examples=["1.0.0"],
        description="version of the data: raise it for each published release",
    )
    creators: tuple[Creator, ...] = Field(
        (Creator(name="Authors not stated"),), min_length=1, description="who made the data set"
    )
    homepage: str | None = Field(
        None,
        pattern=r"^https?://\S+$",
        description="URL of the project's page",
        examples=["https://example.org/dataset"],
    )
    contact: str | None = Field(
        None,
        description="contact for removal requests and questions; default: the project's page",
        examples=["me@example.org"],
    )
    keywords: tuple[str, ...] = Field(
        (), description="search words of the deposit, besides the domain's name"
    )
    biases: tuple[str, ...] = Field(
        (), description="sentences about the domain for cards: who and what is over-represented"
    )
    limits: tuple[str, ...] = Field(
        (), description="the same: what a user of the data should not rely on"
    )
    uses: tuple[str, ...] = Field((), description="the same: what the data can be used for")
    avoid: tuple[str, ...] = Field((), description="the same: what it should not be used for")
    communities: tuple[str, ...] = Field(
        (), description="Zenodo communities that the deposit is offered to"
    )
    licenses: dict[str, str] = Field(
        default_factory=dict,
        description="SPDX id of each folder's licence, which is yours to choose; nothing is"
        " released without. The wiki's own licence is used when its pages name one",
        examples=[dict.fromkeys(("youtube", "reddit", "pairs"), "CC-BY-4.0")],
    )
    shard_mb: float = Field(
        256,
        gt=0,
        description="megabytes after which a released Parquet file ends and the next begins; row"
        " groups of 131,072 rows stay whole",
    )
    open_text: bool = Field(
        False,
        description="release the transcripts of videos that their uploaders marked as Creative"
        " Commons, in release/open-text; uploaders mislabel, and the platform's terms remain",
    )
    published: dict[str, PublishedAt] = Field(
        default_factory=dict,
        description="DOI and address of each folder, where they are known before it is published:"
        " [release.published.youtube]",
    )
    datasheet: Datasheet = Field(
        Datasheet(), description="answers of the authors for the datasheet; in whole sentences"
    )
    max_age_days: int | None = Field(
        None,
        ge=1,
        description="rows that were read through a service's API longer ago are refused; a"
        " source's own max_age_days takes precedence",
    )
    emails_per_thousand: float = Field(
        0.2,
        ge=0,
        description="rows with an e-mail address that are tolerated, per 1,000 rows of a table",
    )
    phones_per_thousand: float = Field(
        0.5,
        ge=0,
        description="rows with a phone number that are tolerated, per 1,000 rows of a table",
    )
    sample_mb: float = Field(
        4.0, gt=0, le=50, description="size of the sample next to the shards, in megabytes"
    )

    def unsigned(self) -> list[str]:
        """What it lacks to say who made a release: "a creator", "a contact"."""
        creator = [] if "creators" in self.model_fields_set else ["a creator"]
        return creator + ([] if self.contact or self.homepage else ["a contact"])

    def licence_of(self, folder: str) -> str:
        """SPDX id that the profile gives a folder; "" where it gives none. What is made from
        sources is an index as the pairs are, and may be under their licence.
        """
        of_pairs = "" if folder in SOURCES else self.licenses.get("pairs", "")
        return self.licenses.get(folder) or of_pairs

    def unlicensed(self, folders: Iterable[str] = BY_DEFAULT) -> list[str]:
        """Those of these folders that have no licence, but for those whose rows name their own."""
        return [
            name
            for name in folders
            if not (PUBLISHED[name].part_of or PUBLISHED[name].licensed or self.licence_of(name))
        ]

    def published_at(self, source: str) -> PublishedAt:
        """DOI and address of a folder, as far as they are given."""
        return self.published.get(source, PublishedAt())

    @field_validator("published")
    @classmethod
    def _known_folders(cls, value: dict[str, PublishedAt]) -> dict[str, PublishedAt]:
        if unknown := sorted(set(value) - set(PUBLISHED)):
            raise ValueError(f"names {unknown[0]!r}; known: {', '.join(PUBLISHED)}")
        return value

    @field_validator("licenses")
    @classmethod
    def _known_sources(cls, value: dict[str, str]) -> dict[str, str]:
        unknown = sorted(set(value) - set(BY_DEFAULT))
        if unknown:
            raise ValueError(f"names {unknown[0]!r}; known: {', '.join(BY_DEFAULT)}")
        return value
