"""`kb release` itself: the same bytes twice, what it is built from, licences,
tombstones, samples.
"""

from __future__ import annotations

import json
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

import kb
from kb.core.context import Run
from kb.core.licences import KNOWN
from kb.release import sample
from kb.release.build import describe, release
from kb.release.folders import find
from kb.release.metadata.text import render
from kb.store import tombstones
from tests.release.conftest import a_run
from tests.release.made import build


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
    release(a_run(build(first)))
    monkeypatch.setenv("KB_NOW", "2026-11-20T11:11:11Z")
    run = a_run(build(second))
    release(Run(run.settings, run.profile, second, workers=4))
    assert content(first) == content(second)
    release(a_run(first))
    assert content(first) == content(second)


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


def test_every_known_licence_has_its_text() -> None:
    assert all(len(law.text) > 5000 for law in KNOWN.values())


def test_tombstones_follow_and_reach_the_pairs(tmp_path: Path) -> None:
    build(tmp_path)
    tombstones.add(tmp_path, "youtube", [("vid-gone", "deleted")])
    release(a_run(tmp_path))
    for source in ("youtube", "pairs"):
        lines = (tmp_path / "release" / source / "tombstones.ndjson").read_text().splitlines()
        (row,) = map(json.loads, lines)
        assert (row["key"], row["source"], row["reason"]) == ("vid-gone", "youtube", "deleted")
        assert row["removed_at"].endswith("Z")
        (read,) = kb.load(tmp_path / "release")[f"release.{source}_tombstones"].to_pylist()
        assert read["removed_at"] == datetime.fromisoformat(row["removed_at"])
    assert "1 keys were removed" in (tmp_path / "release" / "youtube" / "DATASHEET.md").read_text()


def test_describe_after_a_purge_needs_no_gate(tmp_path: Path) -> None:
    build(tmp_path, sources=("pairs",))
    release(a_run(tmp_path))
    shard = tmp_path / "release" / "pairs" / "pairs-00000-of-00001.parquet"
    pq.write_table(pq.read_table(shard).slice(20), shard)
    describe(a_run(tmp_path), ["pairs"])
    assert "| Rows | 100 |" in (tmp_path / "release" / "pairs" / "README.md").read_text()


def test_sample_is_bounded_and_whole_groups(tmp_path: Path) -> None:
    build(tmp_path, sources=("reddit",), n=5000)
    folder = find(tmp_path)[0]
    total = sum(path.stat().st_size for path in folder.data)
    written = sample.write(folder, total / 4 / 1e6)
    assert sum(path.stat().st_size for path in written) <= total / 4
    posts, comments = (
        [row["post_id"] for row in json.loads(path.read_text(encoding="utf-8"))]
        for path in sorted(written, reverse=True)
    )
    posts = set(posts)
    assert set(comments) == posts
    assert len(comments) == 3 * len(posts)


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


HOSTILE = (
    "Free\n\n# Owned\n<script>alert(1)</script> | x | [here](https://evil.example) `code`"
    " *now*\u2028---"
)


def test_words_of_the_data_are_never_markup_nor_lines(tmp_path: Path) -> None:
    """A licence is what a wiki's file page says, a title and a name what a profile says."""

    def edit(name: str, made: list[dict[str, Any]]) -> None:
        if name == "wiki/images":
            made[0]["license"], made[1]["license"] = HOSTILE, "plain_words"

    profile = tmp_path / "mine.toml"
    profile.write_text(
        f'name = "mine"\ntitle = {json.dumps(HOSTILE)}\n[release]\ncontact ='
        f" {json.dumps(HOSTILE)}\n"
        f"creators = [{{ name = {json.dumps(HOSTILE)} }}]\n"
    )
    release(a_run(build(tmp_path, edit, ("wiki",)), profile))
    folder = tmp_path / "release" / "wiki"
    law = (folder / "LICENSE").read_text()
    assert "\n# Owned" not in law
    assert len([line for line in law.splitlines() if "alert(1)" in line]) == 1
    for name in ("README.md", "DATASHEET.md"):
        text = (folder / name).read_text()
        text = text[text.index("\n# ") :] if name == "README.md" else text  # YAML comes first
        page = MarkdownIt("commonmark").enable("table").parse(text)
        inside = [token for block in page for token in block.children or ()]
        assert not [token for token in (*page, *inside) if token.type.startswith("html")]
        links = [str(token.attrs["href"]) for token in inside if token.type == "link_open"]
        assert not [link for link in links if "evil" in link]
        headings = [after.content for token, after in pairwise(page) if token.tag == "h1"]
        assert "Owned" not in headings
        # Shown as they were written, in one piece: in the title, and in the table of licences.
        words = [block for block in page if "alert(1)" in block.content and block.children]
        seen = ["".join(token.content for token in block.children or ()) for block in words]
        assert any("<script>alert(1)</script> | x | [here]" in said for said in seen)
        assert "plain_words" in text
    said = MarkdownIt("commonmark").parse((folder / "README.md").read_text())
    fence = next(token for token in said if token.info == "bibtex")
    assert fence.content.count("\n") == 7


def test_a_template_with_an_unknown_name_fails() -> None:
    with pytest.raises(UndefinedError, match="'about' is undefined"):
        render("licence.txt", law=KNOWN["CC0-1.0"], facts=None)
