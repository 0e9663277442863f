"""croissant.json: Croissant 1.1 with its responsible-AI part, derived from `schemas/` and the data.

Source: https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html and
croissant-rai-spec.html. Made without mlcroissant, which the tests use to validate it and to load
every record. What a folder was made of, by which steps and software, is in terms of W3C's PROV-O
(https://www.w3.org/TR/prov-o/).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from kb.core.config.profile.release import Creator
from kb.core.context import Run
from kb.core.licences import licence
from kb.core.sources import PUBLISHED, SOURCES, made_of
from kb.release.metadata.card import bibtex
from kb.release.metadata.measure import DataFile, Facts, TableFacts
from kb.release.metadata.templates import about, dataset_name, day, language, name, notes
from kb.release.provenance import made_with
from kb.schema.tables import Column, Table

PARQUET = "application/x-parquet"
CONFORMS = ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"]
# The specification's context; "@language" tags names and descriptions.
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "prov": "http://www.w3.org/ns/prov#",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}


def croissant(run: Run, facts: Facts) -> str:
    """The whole document as text."""
    prose, section = about(run.profile, facts), run.profile.release
    published = section.published_at(facts.source)
    files = [
        *(file for table in facts.tables for file in _files(table)),
        *map(_archive, facts.others),
    ]
    for file in files:
        if published.files and "contentUrl" in file:  # absolute, as the profile says where
            file["contentUrl"] = f"{published.files}/{file['name']}"
    document = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS,
        "name": name(run, facts),
        "description": " ".join((prose.summary, *notes(facts))),
        "license": licence(facts.licence).url,
        "version": section.version,
        "citeAs": bibtex(run, facts),
        "creator": [_creator(creator) for creator in section.creators],
        "keywords": list(dict.fromkeys((run.profile.name, *prose.words, *section.keywords))),
        **({"datePublished": day(facts.built)} if facts.built else {}),
        "inLanguage": language(run),
        **({"url": section.homepage} if section.homepage else {}),
        **({"identifier": f"https://doi.org/{published.doi}"} if published.doi else {}),
        **({"temporalCoverage": "/".join(map(day, facts.made))} if facts.made else {}),
        "usageInfo": {
            "@type": "sc:CreativeWork",
            "name": "Terms of use",
            "text": " ".join(
                (prose.attribution, licence(facts.licence).short, *_not_for(prose.avoid))
            ),
        },
        "prov:wasDerivedFrom": _origins(run, facts.source),
        "prov:wasGeneratedBy": _activities(run, facts),
        **_responsible(run, facts),
        "distribution": files,
        "recordSet": [
            *(_splits(table.table) for table in facts.tables if table.table.split_by),
            *(_records(table, _referenced(table, facts)) for table in facts.tables),
        ],
    }
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"


def _creator(creator: Creator) -> dict[str, Any]:
    """A person, whose family name comes first, or a group."""
    made: dict[str, Any] = {
        "@type": "sc:Organization" if "," not in creator.name else "sc:Person",
        "name": creator.name,
    }
    if creator.orcid:
        made["@id"] = made["url"] = f"https://orcid.org/{creator.orcid}"
    if creator.affiliation:
        made["affiliation"] = {"@type": "sc:Organization", "name": creator.affiliation}
    return made


def _not_for(uses: Iterable[str]) -> list[str]:
    return ["not for: " + what for what in uses]


def _responsible(run: Run, facts: Facts) -> dict[str, Any]:
    prose = about(run.profile, facts)
    emails, phones = (sum(counts[i] for counts in facts.personal.values()) for i in (1, 2))
    fields = {
        "rai:dataCollection": prose.collection,
        "rai:dataCollectionType": list(prose.kinds),
        "rai:dataCollectionRawData": prose.raw,
        "rai:dataCollectionMissingData": prose.absent,
        "rai:dataPreprocessingProtocol": list(prose.processing),
        "rai:dataAnnotationProtocol": [
            f"Texts were scored by the toxicity model {model} ({revision}) in {precision}."
            for model, revision, precision in facts.models
        ],
        "rai:machineAnnotationTools": [
            f"Detoxify {model} {revision} {precision}"
            for model, revision, precision in facts.models
        ],
        "rai:hasSyntheticData": facts.sandbox,
        "rai:dataBiases": list(prose.biases),
        "rai:dataLimitations": [*prose.limits, *_not_for(prose.avoid)],
        "rai:dataUseCases": list(prose.uses),
        "rai:personalSensitiveInformation": [
            prose.people,
            (
                f"Measured in the released texts: {emails:,} rows with an e-mail address,"
                f" {phones:,} with a phone number."
            ),
        ],
        "rai:dataReleaseMaintenancePlan": prose.upkeep,
        "rai:dataSocialImpact": f"Lets research on {run.profile.title} be repeated on stated data. "
        "Harm by exposure of people is limited by leaving names and deleted material out.",
    }
    if facts.read:
        fields["rai:dataCollectionTimeframe"] = [day(moment) for moment in facts.read]
    return {key: what for key, what in fields.items() if what or what is False}


def _files(table: TableFacts) -> list[dict[str, Any]]:
    """A file object for each shard, with its checksum; a file set where a table has several."""
    files: list[dict[str, Any]] = [
        {
            "@type": "cr:FileObject",
            "@id": file.name,
            "name": file.name,
            "description": f"{file.rows:,} rows of {table.table.short}.",
            "contentUrl": file.name,
            "contentSize": f"{file.size} B",
            "encodingFormat": PARQUET,
            "sha256": file.sha256,
        }
        for file in table.files
    ]
    if len(files) > 1:
        files.append(
            {
                "@type": "cr:FileSet",
                "@id": f"{table.table.short}-files",
                "name": f"{table.table.short}-files",
                "description": f"All shards of {table.table.short}.",
                "encodingFormat": PARQUET,
                "includes": [split.glob for split in table.splits]
                if table.table.split_by
                else f"{table.table.short}-*-of-*.parquet",
            }
        )
    return files


_FORMATS = {
    ".txt": ("text/plain", "Ids of the videos, one a line, those with the most rows first."),
    ".tar": ("application/x-tar", "Files that path columns name as <tar>/<member>."),
    ".ndjson": (
        "application/jsonlines",
        "One JSON object a line: an index of what the archives hold.",
    ),
}


def _archive(file: DataFile) -> dict[str, Any]:
    suffix = "." + file.name.rpartition(".")[2]
    kind, about = _FORMATS.get(
        suffix, ("application/octet-stream", "A file that belongs to the tables.")
    )
    return {
        "@type": "cr:FileObject",
        "@id": file.name,
        "name": file.name,
        "description": about,
        "contentUrl": file.name,
        "contentSize": f"{file.size} B",
        "encodingFormat": kind,
        "sha256": file.sha256,
    }


def _referenced(table: TableFacts, facts: Facts) -> dict[str, str]:
    """Column → the field of another table whose rows it names: their whole key. Of two tables that
    name each other the main one is referenced: readers allow no circle.
    """
    own = table.table
    return {
        other.key[0]: f"{other.short}/{other.key[0]}"
        for other in (fact.table for fact in facts.tables)
        if other.short != own.short
        and _names(own, other)
        and (not _names(other, own) or other.short == PUBLISHED[facts.source].main)
    }


def _names(declared: Table, other: Table) -> bool:
    """Whether a released column of a table is the key of another one."""
    return len(other.key) == 1 and other.key[0] in declared.names(released=True)


_SPLITS = {
    "train": "cr:TrainingSplit",
    "validation": "cr:ValidationSplit",
    "test": "cr:TestSplit",
}


def _splits(table: Table) -> dict[str, Any]:
    """The record set that names the splits of a table, as Croissant's section on splits has it."""
    name, url = (f"{table.short}_splits/{part}" for part in ("name", "url"))
    return {
        "@type": "cr:RecordSet",
        "@id": f"{table.short}_splits",
        "name": f"{table.short}_splits",
        "description": f"Names of the splits of {table.short}.",
        "dataType": "cr:Split",
        "key": {"@id": name},
        "field": [
            {"@type": "cr:Field", "@id": one, "name": one.rpartition("/")[2], "dataType": kind}
            for one, kind in ((name, "sc:Text"), (url, "sc:URL"))
        ],
        "data": [
            {name: split, url: _SPLITS[split].replace("cr:", CONTEXT["cr"])}
            for split in table.stems
        ],
    }


def _records(table: TableFacts, referenced: Mapping[str, str]) -> dict[str, Any]:
    short = table.table.short
    source = (
        {"fileObject": {"@id": table.files[0].name}}
        if len(table.files) == 1
        else {"fileSet": {"@id": f"{short}-files"}}
    )
    return {
        "@type": "cr:RecordSet",
        "@id": short,
        "name": short,
        "description": f"{table.table.doc} {table.rows:,} rows.",
        "key": [{"@id": f"{short}/{column}"} for column in table.table.key],
        "field": [
            _field(
                short,
                fact.column,
                source,
                f"{short}_splits/name"
                if fact.column.name == table.table.split_by
                else referenced.get(fact.column.name, ""),
                table.table.stems if fact.column.name == table.table.split_by else (),
            )
            for fact in table.columns
        ],
    }


def _field(
    short: str, column: Column, source: dict[str, Any], referenced: str, stems: Sequence[str] = ()
) -> dict[str, Any]:
    """A column, and the field of another table that it references; of a list of structs the parts
    of each as fields below it. `stems`: of the column that names the files, its values.
    """
    key = f"{short}/{column.name}"
    made = {"@type": "cr:Field", "@id": key, "name": column.name, "description": _described(column)}
    extract = {**source, "extract": {"column": column.name}}
    if stems:  # by the names of files, so that a loader reads those of one split alone
        named = f"^({'|'.join(stems)})-.+parquet$"
        extract = {**source, "extract": {"fileProperty": "fullpath"}, "transform": {"regex": named}}
    parts = column.parsed.item.fields if column.parsed.item is not None else ()
    if not parts:
        joined = {"references": {"field": {"@id": referenced}}} if referenced else {}
        return {**made, "dataType": column.parsed.croissant(), "source": extract, **joined}
    below = [
        {
            "@type": "cr:Field",
            "@id": f"{key}/{part}",
            "name": part,
            "description": f"{part} of each of them.",
            "dataType": kind.croissant(),
            "source": {**extract, "transform": {"jsonPath": part}},
        }
        for part, kind in parts
    ]
    return {**made, "repeated": True, "subField": below}


def _described(column: Column) -> str:
    parts = [column.doc]
    if column.unit:
        parts.append(f"Unit: {column.unit}.")
    if column.why_null:
        parts.append(f"Null: {column.why_null}.")
    return " ".join(parts)


def _origins(run: Run, source: str) -> list[dict[str, Any]]:
    """The service that a source reads, or the data sets that others are made of."""
    if source not in SOURCES:
        return [
            {"@type": "prov:Entity", "prov:label": dataset_name(run.profile, name)}
            for name in made_of(source)
        ]
    of = SOURCES[source]
    entity = {"@type": "prov:Entity", "prov:label": of.title}
    if address := run.profile.service_address(source):
        entity["url"] = address
    return [entity]


def _activities(run: Run, facts: Facts) -> list[dict[str, Any]]:
    """A step each, in order. Times are those of the data; a step without them has none."""
    prose = about(run.profile, facts)
    steps: list[tuple[str, str, tuple[datetime, datetime] | None]] = [
        ("collection", prose.collection, facts.read),
        ("processing", " ".join(prose.processing), None),
        *(
            ("annotation", f"Toxicity was scored by {model} {revision} in {precision}.", None)
            for model, revision, precision in facts.models
        ),
        ("release", f"Version {run.profile.release.version} was checked and described.", None),
    ]
    return [
        {
            "@type": "prov:Activity",
            "prov:label": label,
            "description": text,
            **(
                {
                    "prov:startedAtTime": times[0].isoformat(),
                    "prov:endedAtTime": times[1].isoformat(),
                }
                if times
                else {}
            ),
            "prov:wasAssociatedWith": _agent(run),
        }
        for label, text, times in steps
    ]


def _agent(run: Run) -> dict[str, Any]:
    """The software, with what decides its results."""
    used = made_with(run)
    software, profile = used["software"], used["profile"]
    return {
        "@type": "prov:SoftwareAgent",
        "prov:label": software["name"],
        "softwareVersion": software["version"],
        **({"url": software["url"]} if "url" in software else {}),
        "additionalProperty": [
            {"@type": "sc:PropertyValue", "name": name, "value": value}
            for name, value in (
                ("lock_sha256", software["lock_sha256"]),
                ("profile", profile["name"]),
                ("profile_sha256", profile["sha256"]),
                ("seed", profile["seed"]),
            )
            if value != ""
        ],
    }
