"""What a folder was made from, by which steps and with which software, in W3C PROV-O terms.

Source: https://www.w3.org/TR/prov-o/ and the Croissant specification 1.1, which takes its terms.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any

from kb.core.context import Run
from kb.core.sources import SOURCES, made_of
from kb.release.metadata.measure import Facts
from kb.release.metadata.templates import about, dataset_name
from kb.release.provenance import made_with

CONTEXT = "http://www.w3.org/ns/prov#"


def lineage(run: Run, facts: Facts) -> dict[str, Any]:
    """`prov:wasDerivedFrom` and `prov:wasGeneratedBy` of a folder."""
    return {
        "prov:wasDerivedFrom": _origins(run, facts.source),
        "prov:wasGeneratedBy": _activities(run, facts),
    }


def _origins(run: Run, source: str) -> list[dict[str, Any]]:
    """The service that a source reads, or the data sets that others are made of."""
    if source not in SOURCES:
        return [
            {"@type": "prov:Entity", "prov:label": dataset_name(run.profile, one)}
            for one in made_of(source)
        ]
    of = SOURCES[source]
    entity = {"@type": "prov:Entity", "prov:label": of.title}
    if address := of.origin(run.profile):
        entity["url"] = address
    return [entity]


def _activities(run: Run, facts: Facts) -> list[dict[str, Any]]:
    """A step each, in order. Times are those of the data; a step without them has none."""
    prose = about(run.profile, facts.source)
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
