"""datacite.json: what DataCite's schema 4.6 requires, in its controlled words."""

import json
import re
from pathlib import Path

import pytest

from kb.core.sources import BY_DEFAULT
from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.made import build

REQUIRED = {"creators", "titles", "publisher", "publicationYear", "types", "schemaVersion"}
DATES = {"Collected", "Coverage", "Issued"}
RELATIONS = {"IsDocumentedBy", "IsCompiledBy"}


@pytest.mark.parametrize("source", BY_DEFAULT)
def test_a_deposit_has_what_datacite_requires(released: Path, source: str) -> None:
    folder = released / "release" / source
    found = json.loads((folder / "datacite.json").read_text(encoding="utf-8"))
    deposit = json.loads((folder / "zenodo.json").read_text(encoding="utf-8"))["metadata"]
    assert all(found[name] for name in REQUIRED)
    assert found["types"]["resourceTypeGeneral"] == "Dataset"
    assert found["titles"] == [{"title": deposit["title"], "lang": "en"}]
    assert found["publicationYear"] == deposit["publication_date"][:4]  # text in its JSON schema
    assert found["version"] == deposit["version"]
    assert found["rightsList"][0]["rightsIdentifier"] == deposit["license"]
    day = r"\d{4}-\d{2}-\d{2}"
    for one in found["dates"]:
        assert one["dateType"] in DATES
        assert re.fullmatch(f"{day}(/{day})?", one["date"])
    assert {one["relationType"] for one in found["relatedIdentifiers"]} <= RELATIONS


def test_people_and_groups_are_told_apart(tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[release]\ncreators = [{ name = "Doe, Jane", affiliation ='
        ' "A: B", orcid = "0000-0002-1825-0097" }, { name = "The group" }]\n'
    )
    release(a_run(build(tmp_path, sources=("pairs",)), profile))
    found = json.loads((tmp_path / "release/pairs/datacite.json").read_text())
    assert found["creators"] == [
        {
            "name": "Doe, Jane",
            "nameType": "Personal",
            "familyName": "Doe",
            "givenName": "Jane",
            "nameIdentifiers": [
                {
                    "nameIdentifier": "https://orcid.org/0000-0002-1825-0097",
                    "nameIdentifierScheme": "ORCID",
                    "schemeUri": "https://orcid.org",
                }
            ],
            "affiliation": [{"name": "A: B"}],
        },
        {"name": "The group", "nameType": "Organizational"},
    ]
