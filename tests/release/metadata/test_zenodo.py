"""What zenodo.json says."""

import json
from pathlib import Path

import pytest

from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.made import build


def test_names_and_orcids_reach_citation_and_deposit(tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine: \\"quoted\\""\n[release]\nhomepage ='
        ' "https://kb.example.org"\ncontact = "https://kb.example.org/remove"\nversion = "2.0.1"\n'
        'creators = [{ name = "Doe, Jane", affiliation = "A: B", orcid = "0000-0002-1825-0097" }, '
        '{ name = "The group" }]\n'
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


@pytest.mark.parametrize(("written", "sent"), [("de", "deu"), ("deu", "deu"), ("qq", None)])
def test_language_of_the_profile_reaches_the_deposit(
    tmp_path: Path, written: str, sent: str | None
) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[youtube]\nkeywords = ["x"]\ncategory_ids ='
        f' [20]\nlanguage = "{written}"\n'
    )
    release(a_run(build(tmp_path, sources=("pairs",), n=10), profile))
    folder = tmp_path / "release" / "pairs"
    assert json.loads((folder / "zenodo.json").read_text())["metadata"].get("language") == sent
    assert f"language:\n- {written}\n" in (folder / "README.md").read_text()
