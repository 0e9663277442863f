"""`kb release` itself: the same bytes twice, what it is built from, licences,
tombstones, samples.
"""

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

import kb
from kb.core.context import Run
from kb.core.licences import KNOWN
from kb.release.build import write_samples
from kb.release.folders import in_root
from kb.store.state import tombstones
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import build

SOURCES = ("youtube", "wiki", "pairs")


def content(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted((root / "release").rglob("*"))
        if path.is_file()
    }


def test_same_bytes_twice_later_and_with_more_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "a", tmp_path / "elsewhere" / "b"
    release(a_run(build(first, sources=SOURCES)))
    monkeypatch.setenv("KB_NOW", "2026-11-20T11:11:11Z")
    run = a_run(build(second, sources=SOURCES))
    release(Run(run.settings, run.profile, second, workers=4))
    assert content(first) == content(second)
    release(a_run(first))
    assert content(first) == content(second)


def test_every_known_licence_has_its_text() -> None:
    assert all(len(law.text) > 5000 for law in KNOWN.values())


def test_tombstones_follow_and_reach_the_pairs(tmp_path: Path) -> None:
    build(tmp_path, sources=SOURCES)
    tombstones.add_tombstones(tmp_path, "youtube", [("vid-gone", "deleted")])
    release(a_run(tmp_path))
    for source in ("youtube", "pairs"):
        lines = (tmp_path / "release" / source / "tombstones.ndjson").read_text().splitlines()
        (row,) = map(json.loads, lines)
        assert (row["key"], row["source"], row["reason"]) == ("vid-gone", "youtube", "deleted")
        assert row["removed_at"].endswith("Z")
        (read,) = kb.load(tmp_path / "release")[f"release.{source}_tombstones"].to_pylist()
        assert read["removed_at"] == datetime.fromisoformat(row["removed_at"])
    assert "1 keys were removed" in (tmp_path / "release" / "youtube" / "DATASHEET.md").read_text()


def test_empty_tables_are_released_as_such(tmp_path: Path) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "reddit/comments":
            made.clear()

    summary = release(a_run(build(tmp_path, edit, ("reddit",))))
    assert summary["sources"]["reddit"]["comments"] == 0


def test_wiki_archives_belong_to_the_release(tmp_path: Path) -> None:
    build(tmp_path, sources=("wiki",))
    release(a_run(tmp_path))
    raw = json.loads((tmp_path / "release" / "wiki" / "croissant.json").read_text())
    assert any(
        file["@id"] == "images-00000-of-00001.tar" and file["encodingFormat"] == "application/x-tar"
        for file in raw["distribution"]
    )
    assert "images-00000-of-00001.tar" in (tmp_path / "release" / "wiki" / "SHA256SUMS").read_text()


@pytest.mark.parametrize(("spdx", "alike"), [("CC0-1.0", False), ("CC-BY-NC-SA-3.0", True)])
def test_duties_are_those_of_the_licence(tmp_path: Path, spdx: str, alike: bool) -> None:
    def edit(name: str, made: list[dict[str, Any]]) -> None:
        for row in made if name == "wiki/pages" else []:
            row["license"] = spdx

    release(a_run(build(tmp_path, edit, ("wiki",), n=10)))
    folder = tmp_path / "release" / "wiki"
    head = (folder / "LICENSE").read_text().partition("-" * 72)[0]
    for text in (
        head,
        json.loads((folder / "zenodo.json").read_text())["metadata"]["description"],
        (folder / "README.md").read_text(),
    ):
        assert ("alike" in text or "under the same licence" in text) is alike
        assert KNOWN[spdx].short in text


@pytest.mark.parametrize("source", ["reddit", "pairs", "wiki", "links", "youtube", "tasks"])
def test_samples_are_short_and_of_the_same_keys(tmp_path: Path, source: str) -> None:
    build(tmp_path, sources=(source,), n=200)
    folder = in_root(tmp_path)[0]
    samples = {
        path: json.loads(path.read_text(encoding="utf-8")) for path in write_samples(folder, 4)
    }
    assert all(0 < len(rows) <= 20 for rows in samples.values())
    assert max(map(len, samples.values())) > 5
    shared = {"pairs": "pair_id", "wiki": "page_id", "reddit": "post_id", "links": "entity"}
    if name := shared.get(source):
        keys = [{row[name] for row in rows} for rows in samples.values()]
        assert all(one == keys[0] for one in keys)
    small = write_samples(folder, 1e-6)
    assert sum(len(json.loads(path.read_text())) for path in small) <= sum(
        map(len, samples.values())
    )
