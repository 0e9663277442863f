"""datacite.json: the same deposit in the terms of DataCite, which registers DOIs.

Source: DataCite Metadata Schema 4.6, https://schema.datacite.org/meta/kernel-4.6/, in the JSON form
of DataCite's REST API. A DOI is missing until a repository gives one.
"""

import json
from typing import Any

from kb.core.config.profile.release import Creator
from kb.core.context import Run
from kb.core.installation import software_address
from kb.core.licences import licence
from kb.core.terminal import size
from kb.release.metadata.measure import Facts
from kb.release.metadata.templates import about, day, language

_SCHEMA = "http://datacite.org/schema/kernel-4"
_UNAVAILABLE = "(:unav)"  # DataCite's code for a value that is not known yet (appendix 3)


def datacite(run: Run, facts: Facts) -> str:
    """The document as text."""
    section, prose, law = run.profile.release, about(run.profile, facts.source), facts.licence
    related = [(section.homepage, "IsDocumentedBy", "Text")] if section.homepage else []
    if address := software_address():
        related.append((address, "IsCompiledBy", "Software"))
    doi = section.published_at(facts.source).doi
    document = {
        **({"doi": doi} if doi else {}),
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Dataset"},
        "creators": [_creator(one) for one in section.creators],
        "titles": [{"title": prose.title, "lang": "en"}],
        "publisher": {"name": _UNAVAILABLE},
        "publicationYear": str(facts.built.year),
        "subjects": [
            {"subject": word}
            for word in dict.fromkeys((run.profile.title, *prose.words, *section.keywords))
        ],
        "dates": [
            {"date": day(facts.built), "dateType": "Issued"},
            *_span(facts.read, "Collected"),
            *_span(facts.made, "Coverage"),
        ],
        "language": language(run),
        "relatedIdentifiers": [
            {
                "relatedIdentifier": url,
                "relatedIdentifierType": "URL",
                "relationType": relation,
                "resourceTypeGeneral": kind,
            }
            for url, relation, kind in related
        ],
        "sizes": [f"{facts.rows:,} rows", size(facts.size)],
        "formats": ["application/vnd.apache.parquet"],
        "version": section.version,
        "rightsList": [
            {
                "rights": licence(law).title,
                "rightsUri": licence(law).url,
                "rightsIdentifier": law.lower(),
                "rightsIdentifierScheme": "SPDX",
                "schemeUri": "https://spdx.org/licenses/",
            }
        ],
        "descriptions": [
            {"description": prose.summary, "descriptionType": "Abstract", "lang": "en"},
            {"description": prose.collection, "descriptionType": "Methods", "lang": "en"},
        ],
        "schemaVersion": _SCHEMA,
    }
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"


def _creator(creator: Creator) -> dict[str, Any]:
    """A person, whose family name comes first, or a group."""
    family, comma, given = creator.name.partition(",")
    made: dict[str, Any] = {"name": creator.name, "nameType": "Organizational"}
    if comma:
        made |= {
            "nameType": "Personal",
            "familyName": family.strip(),
            "givenName": given.strip(),
        }
    if creator.orcid:
        made["nameIdentifiers"] = [
            {
                "nameIdentifier": f"https://orcid.org/{creator.orcid}",
                "nameIdentifierScheme": "ORCID",
                "schemeUri": "https://orcid.org",
            }
        ]
    if creator.affiliation:
        made["affiliation"] = [{"name": creator.affiliation}]
    return made


def _span(dates: Any, kind: str) -> list[dict[str, str]]:
    """A range of dates (RKMS-ISO8601), if it is known."""
    return [{"date": "/".join(map(day, dates)), "dateType": kind}] if dates else []
