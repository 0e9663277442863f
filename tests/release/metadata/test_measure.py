"""Licences and dates, measured on the rows."""

import json
from pathlib import Path
from typing import Any

from kb.core.licences import KNOWN
from kb.release.build import release
from tests.release.conftest import a_run
from tests.release.made import build


def test_date_is_the_newest_reading_or_source_date_epoch(tmp_path: Path) -> None:
    build(tmp_path, sources=("youtube",))
    release(a_run(tmp_path))
    deposit = tmp_path / "release" / "youtube" / "zenodo.json"
    assert json.loads(deposit.read_text())["metadata"]["publication_date"] == "2026-11-03"
    release(a_run(tmp_path, source_date_epoch=1_800_000_000))
    assert json.loads(deposit.read_text())["metadata"]["publication_date"] == "2027-01-15"
    assert "date-released: 2027-01-15" in (deposit.parent / "CITATION.cff").read_text()


def test_licences_of_a_wiki_whose_rows_name_several(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "wiki/images":
            made[0]["license"], made[1]["license"] = "CC0-1.0", "all rights reserved"
        if name == "wiki/pages":
            for row in made:
                row["license"] = "CC-BY-SA-4.0"

    release(a_run(build(tmp_path, edit, ("wiki",))))
    folder = tmp_path / "release" / "wiki"
    assert json.loads((folder / "zenodo.json").read_text())["metadata"]["license"] == "cc-by-sa-4.0"
    assert KNOWN["CC-BY-SA-4.0"].text in (folder / "LICENSE").read_text()
    assert [path.name for path in folder.glob("LICENSE-*")] == ["LICENSE-CC0-1.0.txt"]
    assert "all rights reserved (1 rows)" in (folder / "LICENSE").read_text()


def test_wiki_that_names_no_licence_takes_the_profiles(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "wiki/pages" else []:
            row["license"] = None

    profile = tmp_path / "mine.toml"
    profile.write_text(
        'name = "mine"\ntitle = "Mine"\n[release.licenses]\nwiki = "CC-BY-NC-SA-3.0"\n'
    )
    release(a_run(build(tmp_path, edit, ("wiki",)), profile))
    assert "CC-BY-NC-SA-3.0" in (tmp_path / "release" / "wiki" / "LICENSE").read_text()
