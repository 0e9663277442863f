"""What a folder was made with, what changed since the release before, and who made it."""

import hashlib
import json
import shutil
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from cffconvert import Citation

from kb.core import installation
from kb.core.config.profile import load_profile
from kb.core.errors import NotReleasable
from kb.pairs import keywords
from kb.release.publish.publish import publish
from kb.store.state import tombstones
from kb.version import __version__
from tests.faults import Sandbox
from tests.recipes import release
from tests.release.conftest import a_run
from tests.release.made import build
from tests.release.signed import LINES, signed

LOCK = Path(__file__).resolve().parents[2] / ".ci" / "requirements.lock"
HEADER = "keyword\tkind\trule\tforms\n"


def test_every_folder_holds_what_made_it(released: Path) -> None:
    profile = load_profile(signed())
    lock = hashlib.sha256(LOCK.read_bytes()).hexdigest()
    for source in ("youtube", "wiki", "reddit", "pairs"):
        folder = released / "release" / source
        assert (folder / "profile.toml").read_bytes() == signed().read_bytes()
        rows = (folder / "keywords.tsv").read_text().splitlines()
        assert rows[0] == HEADER.rstrip()
        assert {line.count("\t") for line in rows} == {3}  # no comments, every column
        mine, shipped = folder / "keywords.tsv", signed().with_name("keywords.tsv")
        assert keywords.read_keywords(mine, 20) == keywords.read_keywords(shipped, 20)
        sums = (folder / "SHA256SUMS").read_text()
        assert all(name in sums for name in ("profile.toml", "keywords.tsv", "provenance.json"))
        said = json.loads((folder / "provenance.json").read_text())
        assert said["software"] == {
            "name": "lorecrawl", "version": __version__, "lock_sha256": lock
        }  # fmt: skip
        assert (said["profile"]["seed"], said["version"]) == (profile.seed, "1.0.0")
        card = (folder / "README.md").read_text()
        assert f"Lorecrawl {__version__}" in card
        assert lock in card
        assert "seed 0" in card
        assert "This is the first version." in card
    assert "| `youtube.min_views` | 100 |" in (released / "release/youtube/README.md").read_text()
    youtube = (released / "release/youtube/README.md").read_text()
    assert "Minecraft Walkthrough" in youtube
    assert "redstone" in (released / "release/reddit/README.md").read_text()
    assert "| `pairs.max_clip_s` | 16 |" in (released / "release/pairs/README.md").read_text()


def test_the_profile_in_a_folder_works_with_the_list_beside_it(tmp_path: Path) -> None:
    (tmp_path / "lists").mkdir()
    (tmp_path / "lists" / "a.tsv").write_text(f"# plants\n{HEADER}Saxifrage\tplant\n")
    (tmp_path / "b.tsv").write_text(f"{HEADER}Trough\tplace\tnear:10\ttub\n")
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\ntitle = "Mine"\n[pairs]\nkeyword_files = [\n  "lists/a.tsv",\n'
        f'  "b.tsv",\n]\nnear_words = 7\n[release]\n{LINES}'
    )
    root = build(tmp_path / "root", sources=("pairs",), n=10)
    release(a_run(root, path))
    used = load_profile(root / "release" / "pairs" / "profile.toml")
    assert keywords.load(used) == keywords.load(load_profile(path))
    assert used.model_dump(exclude={"pairs"}) == load_profile(path).model_dump(exclude={"pairs"})
    assert used.section("pairs").near_words == 7


def test_what_changed_since_the_release_before(tmp_path: Path) -> None:
    root = build(tmp_path, sources=("pairs",), n=40)
    path = tmp_path / "mine.toml"

    def made(version: str, n: int) -> tuple[str, dict]:
        path.write_text(f'name = "mine"\ntitle = "Mine"\n[release]\nversion = "{version}"\n{LINES}')
        for file in (root / "release" / "pairs").glob("*"):
            file.unlink()
        for file in (root / "pairs").glob("*"):
            file.unlink()
        build(root, sources=("pairs",), n=n)
        release(a_run(root, path))
        folder = root / "release" / "pairs"
        changes = json.loads((folder / "provenance.json").read_text())["changes"]
        return (folder / "README.md").read_text(), changes

    assert made("1.0.0", 40)[1] is None
    card, changes = made("1.1.0", 70)
    assert changes["version"] == "1.0.0"
    assert changes["tables"] == [  # the invented pairs of half of the ids are of other videos then
        {"table": name, "added": 60, "gone": 0, "changed": 40, "reasons": {}}
        for name in ("pairs", "quality")
    ]
    assert "Since version 1.0.0" in card
    assert "| pairs | 60 | 0 | 40 | |" in card
    assert made("1.1.0", 70) == (card, changes)  # made again, nothing else is said
    _, changes = made("1.10.0", 25)
    assert (changes["version"], changes["tables"][0]["gone"]) == ("1.1.0", 90)


def test_rows_that_changed_and_why_others_went(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    root = tmp_path / "root"

    def made(version: str, edit: Any) -> dict[str, Any]:
        path.write_text(f'name = "mine"\ntitle = "Mine"\n[release]\nversion = "{version}"\n{LINES}')
        for folder in ("release", "clean"):
            shutil.rmtree(root / folder, ignore_errors=True)
        release(a_run(build(root, edit, ("youtube",), n=20), path))
        document = json.loads((root / "release/youtube/provenance.json").read_text())
        changes: dict[str, Any] = document["changes"]
        return changes

    def later(name: str, rows: list[dict[str, Any]]) -> None:
        if name == "youtube/videos":
            tombstones.add_tombstones(root, "youtube", [(rows.pop(0)["video_id"], "named")])
            rows[0]["view_count"] += 1
            rows[1]["fetched_at"] += timedelta(hours=1)

    made("1.0.0", lambda *_: None)
    changed = {table["table"]: table for table in made("1.1.0", later)["tables"]}
    assert changed["videos"] == {
        "table": "videos",
        "added": 0,
        "gone": 1,
        "changed": 1,
        "reasons": {"removed": 1},
    }
    card = (root / "release" / "youtube" / "README.md").read_text()
    assert "| videos | 0 | 1 | 1 | removed 1 |" in card


@pytest.mark.parametrize("lacking", ["contact", "creators", "licenses"])
def test_a_release_and_publish_ask_for_licence_creator_and_contact(
    lacking: str, tmp_path: Path
) -> None:
    root = build(tmp_path, sources=("pairs",), n=10)
    path = tmp_path / "mine.toml"
    head = 'name = "mine"\ntitle = "Mine"\n[release]\n'
    lines = [line for line in LINES.splitlines() if not line.startswith(lacking)]
    path.write_text(head + "\n".join(lines) + "\n")
    before = sorted(root.rglob("*"))
    named = {"contact": "no contact", "creators": "no creator"}.get(lacking, "no licence of pairs")
    with Sandbox(services=["zenodo"]) as service:
        settings = {
            "kb_zenodo_endpoint": service.servers["zenodo"].url,
            "zenodo_token": service.settings()["ZENODO_TOKEN"],
        }
        with pytest.raises(NotReleasable, match=named):
            release(a_run(root, path))
        assert sorted(root.rglob("*")) == before
        with pytest.raises(NotReleasable, match=named):
            publish(a_run(root, path, **settings), "zenodo-sandbox")
        assert service.ledger.requests() == []
        path.write_text(head + LINES)
        release(a_run(root, path))
        assert publish(a_run(root, path, **settings), "zenodo-sandbox")["drafts"] == 1


def test_papers_name_where_the_software_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, released: Path
) -> None:
    """As soon as its package says so; without it they name a version and no address."""
    address = "https://git.example.org/lorecrawl"
    assert "git.example.org" not in (released / "release/wiki/README.md").read_text()
    package = tmp_path / "site" / f"lorecrawl-{__version__}.dist-info"
    package.mkdir(parents=True)
    (package / "METADATA").write_text(
        f"Metadata-Version: 2.4\nName: lorecrawl\nVersion: {__version__}\n"
        f"Project-URL: Documentation, https://docs.example.org\nProject-URL: Source, {address}\n"
    )
    monkeypatch.syspath_prepend(package.parent)
    installation.software_address.cache_clear()
    root = build(tmp_path / "root", sources=("wiki",))
    release(a_run(root))
    installation.software_address.cache_clear()
    folder = root / "release" / "wiki"
    assert json.loads((folder / "provenance.json").read_text())["software"]["url"] == address
    assert f"repository-code: {address}" in (folder / "CITATION.cff").read_text().replace('"', "")
    for name in ("README.md", "DATASHEET.md"):
        assert address in (folder / name).read_text(), name
    deposit = json.loads((folder / "zenodo.json").read_text())["metadata"]
    compiled = {"identifier": address, "relation": "isCompiledBy", "resource_type": "software"}
    assert compiled in deposit["related_identifiers"]
    Citation((folder / "CITATION.cff").read_text(), src="CITATION.cff").validate()
