"""zenodo.json: the deposit's metadata, as a model of our own of Zenodo's documented fields.

Source: https://developers.zenodo.org, "Deposit metadata". A deposit without a licence silently
becomes CC0 there, so `license` has no default here. The codes of languages are those of ISO 639-1
and 639-2 (terminological), https://www.loc.gov/standards/iso639-2/.
"""

import html
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from kb.core import terminal
from kb.core.config.profile.release import Release
from kb.core.context import Run
from kb.core.installation import software_address
from kb.core.licences import licence
from kb.core.sources import SOURCES, made_of
from kb.release.metadata.measure import Facts
from kb.release.metadata.templates import about, day, language, name, notes, span

# Two letters, as profiles write them, and the three that Zenodo asks for.
_CODES = """
aa aar ab abk af afr ak aka am amh an arg ar ara as asm av ava ay aym az aze ba bak be bel bg bul
bi bis bm bam bn ben bo bod br bre bs bos ca cat ce che ch cha co cos cr cre cs ces cv chv cy cym
da dan de deu dv div dz dzo ee ewe el ell en eng eo epo es spa et est eu eus fa fas ff ful fi fin
fj fij fo fao fr fra fy fry ga gle gd gla gl glg gn grn gu guj gv glv ha hau he heb hi hin ho hmo
hr hrv ht hat hu hun hy hye hz her ia ina id ind ie ile ig ibo ii iii ik ipk io ido is isl it ita
iu iku ja jpn jv jav ka kat kg kon ki kik kj kua kk kaz kl kal km khm kn kan ko kor kr kau ks kas
ku kur kv kom kw cor ky kir la lat lb ltz lg lug li lim ln lin lo lao lt lit lu lub lv lav mg mlg
mh mah mi mri mk mkd ml mal mn mon mr mar ms msa mt mlt my mya na nau nb nob nd nde ne nep ng ndo
nl nld nn nno no nor nr nbl nv nav ny nya oc oci oj oji om orm or ori os oss pa pan pi pli pl pol
ps pus pt por qu que rm roh rn run ro ron ru rus rw kin sa san sc srd sd snd se sme sg sag si sin
sk slk sl slv sm smo sn sna so som sq sqi sr srp ss ssw st sot su sun sv swe sw swa ta tam te tel
tg tgk th tha ti tir tk tuk tl tgl tn tsn to ton tr tur ts tso tt tat tw twi ty tah ug uig uk ukr
ur urd uz uzb ve ven vi vie vo vol wa wln wo wol xh xho yi yid yo yor za zha zh zho zu zul
"""
_CODE_LIST = _CODES.split()
_THREE = dict(zip(_CODE_LIST[::2], _CODE_LIST[1::2], strict=True))

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
            DepositCreator(name=one.name, affiliation=one.affiliation, orcid=one.orcid)
            for one in section.creators
        ),
        publication_date=day(facts.built) if facts.built else None,
        license=licence(facts.licence).zenodo,
        version=section.version,
        language=three_letters(language(run)),
        keywords=tuple(dict.fromkeys((run.profile.title, *prose.words, *section.keywords))),
        notes=" ".join(notes(facts)) or None,
        communities=tuple(Community(identifier=one) for one in section.communities) or None,
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


def three_letters(code: str) -> str | None:
    """ "de" as "deu"; three letters stay; None for two letters that stand for no language."""
    return code if len(code) == 3 else _THREE.get(code)
