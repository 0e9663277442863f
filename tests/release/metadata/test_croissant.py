"""Croissant files that mlcroissant reads."""

import json
import shutil
from pathlib import Path

import pytest

from kb.core.errors import ProfileError
from kb.core.progress import Progress
from kb.schema import tables
from kb.verify.root import verify
from tests.recipes import release
from tests.release.conftest import SOURCES, TABLES, a_run
from tests.release.made import build, rows
from tests.release.signed import LICENCES, LINES, signed


@pytest.mark.parametrize("name", TABLES)
def test_mlcroissant_loads_every_record(
    downloaded: Path, expected: dict[str, int], name: str
) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    source, _, table = name.partition("/")
    found = list(mlcroissant.Dataset(str(downloaded / source / "croissant.json")).records(table))
    assert len(found) == expected[name]
    assert set(found[0]) == {f"{table}/{column}" for column in tables()[name].names(released=True)}
    if name == "wiki/elements":  # a list of structs is read part by part
        lines = [row["lines"] for row in rows()[name]]
        told = [one[f"{table}/lines"] for one in found]
        for given, parts in zip(lines, told, strict=True):
            bare = [
                {key.rpartition("/")[2]: value for key, value in part.items()} for part in parts
            ]
            assert bare == (given or [dict.fromkeys(("x", "y", "width", "height"))])


@pytest.mark.parametrize("source", SOURCES)
def test_croissant_is_valid_and_says_who_is_concerned(downloaded: Path, source: str) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    metadata = mlcroissant.Dataset(str(downloaded / source / "croissant.json")).metadata
    assert list(metadata.ctx.issues.errors) == []
    warnings = [one for one in metadata.ctx.issues.warnings if "datePublished" not in one]
    assert warnings == []  # nobody knows the date before it is published
    raw = json.loads((downloaded / source / "croissant.json").read_text())
    assert raw["conformsTo"] == [
        "http://mlcommons.org/croissant/1.1",
        "http://mlcommons.org/croissant/RAI/1.0",
    ]
    assert metadata.data_biases
    assert metadata.data_collection
    assert metadata.personal_sensitive_information
    assert metadata.data_use_cases
    assert raw["rai:hasSyntheticData"] is False
    used = json.loads((downloaded / source / "provenance.json").read_text())
    steps = raw["prov:wasGeneratedBy"]
    assert (steps[0]["prov:label"], steps[-1]["prov:label"]) == ("collection", "release")
    for step in steps:
        agent = step["prov:wasAssociatedWith"]
        assert agent["softwareVersion"] == used["software"]["version"]
        named = {one["name"]: one["value"] for one in agent["additionalProperty"]}
        assert named["lock_sha256"] == used["software"]["lock_sha256"]
        assert named["profile_sha256"] == used["profile"]["sha256"]
    timed = [step for step in steps if "prov:startedAtTime" in step]
    assert all(step["prov:startedAtTime"] <= step["prov:endedAtTime"] for step in timed)
    assert all(one["prov:label"] for one in raw["prov:wasDerivedFrom"])
    for file in raw["distribution"]:
        if file["@type"] == "cr:FileObject":
            path = downloaded / source / file["contentUrl"]
            assert file["contentSize"] == f"{path.stat().st_size} B"
            assert (
                f"{file['sha256']}  {path.name}" in (downloaded / source / "SHA256SUMS").read_text()
            )
    described = {
        field["name"]: field["description"]
        for records in raw["recordSet"]
        for field in records["field"]
    }
    assert all(described.values())


def test_doi_and_addresses_that_are_known_before_are_in_every_file(tmp_path: Path) -> None:
    """A draft at Zenodo reserves a DOI; its files get absolute addresses, as validators want."""
    doi, place = "10.5281/zenodo.1234567", "https://zenodo.org/records/1234567/files"
    profile = tmp_path / "profile.toml"
    own = f'[release.published.pairs]\ndoi = "{doi}"\nfiles = "{place}"\n'
    profile.write_text(signed().read_text(encoding="utf-8") + own, encoding="utf-8")
    shutil.copy(signed().with_name("keywords.tsv"), tmp_path)
    root = build(tmp_path / "data", sources=("pairs",))
    release(a_run(root, profile))
    folder = root / "release" / "pairs"
    document = json.loads((folder / "croissant.json").read_text())
    assert document["identifier"] == f"https://doi.org/{doi}"
    files = [one for one in document["distribution"] if one["@type"] == "cr:FileObject"]
    assert {one["contentUrl"] for one in files} == {
        f"{place}/{path.name}" for path in folder.glob("*.parquet")
    }
    assert f'doi: "{doi}"' in (folder / "CITATION.cff").read_text()
    assert f"doi = {{{doi}}}" in (folder / "README.md").read_text()
    assert verify(folder, Progress()).entries == []
    mlcroissant = pytest.importorskip("mlcroissant")
    metadata = mlcroissant.Dataset(str(folder / "croissant.json")).metadata
    assert not metadata.ctx.issues.errors
    with pytest.raises(ProfileError, match=r"release\.published.*names 'video'"):
        profile.write_text(profile.read_text().replace("published.pairs", "published.video"))
        a_run(root, profile)


def test_names_and_orcids_reach_citation_and_deposit(tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine: \\"quoted\\""\n[release]\nhomepage ='
        ' "https://kb.example.org"\ncontact = "https://kb.example.org/remove"\nversion = "2.0.1"\n'
        'creators = [{ name = "Doe, Jane", affiliation = "A: B", orcid = "0000-0002-1825-0097" }, '
        f'{{ name = "The group" }}]\n{LICENCES}'
    )
    release(a_run(build(tmp_path, sources=("pairs",)), profile))
    folder = tmp_path / "release" / "pairs"
    from cffconvert import Citation

    found = Citation((folder / "CITATION.cff").read_text())
    found.validate()
    assert found.cffobj["authors"][0]["family-names"] == "Doe"
    creators = json.loads((folder / "zenodo.json").read_text())["metadata"]["creators"]
    assert creators == [
        {"name": "Doe, Jane", "affiliation": "A: B", "orcid": "0000-0002-1825-0097"},
        {"name": "The group"},
    ]
    assert "https://kb.example.org/remove" in (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("written", "shown", "sent"),
    [("de", "de", "deu"), ("deu", "de", "deu"), ("ger", "de", "deu")],
)
def test_language_of_the_profile_reaches_the_deposit(
    tmp_path: Path, written: str, shown: str, sent: str
) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[youtube]\nkeywords = ["x"]\ncategory_ids ='
        f' [20]\nlanguage = "{written}"\n[release]\n{LINES}'
    )
    release(a_run(build(tmp_path, sources=("pairs",), n=10), profile))
    folder = tmp_path / "release" / "pairs"
    assert json.loads((folder / "zenodo.json").read_text())["metadata"].get("language") == sent
    assert f"language:\n- {shown}\n" in (folder / "README.md").read_text()


def test_record_sets_reference_each_other_and_nothing_is_left_to_warn_of(tmp_path: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    root = build(tmp_path, sources=SOURCES)
    release(a_run(root, source_date_epoch=1_800_000_000))
    found = set()
    for source in SOURCES:
        path = root / "release" / source / "croissant.json"
        issues = mlcroissant.Dataset(str(path)).metadata.ctx.issues
        assert [*issues.errors, *issues.warnings] == []
        document = json.loads(path.read_text())
        assert document["datePublished"] == "2027-01-15"
        found |= {
            (field["@id"], field["references"]["field"]["@id"])
            for records in document["recordSet"]
            for field in records["field"]
            if "references" in field
        }
    assert found >= {
        ("comments/post_id", "posts/post_id"),
        ("elements/page_id", "pages/page_id"),
        ("quality/pair_id", "pairs/pair_id"),
        ("links/entity", "entities/entity"),
    }


def test_the_deposit_names_the_paper_and_the_folders_that_it_belongs_with(tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        f'name = "mine"\ntitle = "Mine"\n[release]\n{LINES}homepage = "https://kb.example.org"\n'
        'published.youtube.doi = "10.5281/zenodo.11"\npublished.reddit.doi = "10.5281/zenodo.12"\n'
        'published.pairs.doi = "10.5281/zenodo.13"\n'
    )
    release(a_run(build(tmp_path, sources=("pairs",)), profile))
    folder = tmp_path / "release" / "pairs"
    deposit = json.loads((folder / "zenodo.json").read_text())["metadata"]
    related = {one["identifier"]: one["relation"] for one in deposit["related_identifiers"]}
    assert related == {
        "arXiv:2206.08853": "references",
        "10.5281/zenodo.11": "isDerivedFrom",
        "10.5281/zenodo.12": "isSupplementTo",
        "https://kb.example.org": "isDocumentedBy",
    }
    assert "url = {https://kb.example.org}" in (folder / "README.md").read_text()
