"""Releases whose files are links, as caches of downloads have them, and a stranger's links."""

import hashlib
import json
import os
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import kb
from kb.core.errors import DamagedData
from kb.query import views
from kb.reader.wiki_page import stored_file
from kb.store.artifact_registry import SUMS
from kb.store.rawlog import sidefiles
from kb.store.tables import checksums, parquet
from kb.store.tables.reading import scan
from tests.inprocess import Here


def hub(release: Path, out: Path) -> Path:
    """As huggingface_hub keeps it: each file is a link to a blob."""
    (out / "blobs").mkdir(parents=True)
    for file in release.iterdir():
        blob = out / "blobs" / hashlib.sha256(file.read_bytes()).hexdigest()
        shutil.copyfile(file, blob)
        place = out / "snapshots" / release.name / file.name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(os.path.relpath(blob, place.parent))
    return out / "snapshots" / release.name


def annex(release: Path, out: Path) -> Path:
    """As git-annex keeps large files: links into a hidden folder; small files are files."""
    out = out / release.name
    objects = out / ".git" / "annex" / "objects"
    objects.mkdir(parents=True)
    for file in release.iterdir():
        if file.suffix not in (".parquet", ".tar"):
            shutil.copyfile(file, out / file.name)
            continue
        data = file.read_bytes()
        key = f"SHA256E-s{len(data)}--{hashlib.sha256(data).hexdigest()}{file.suffix}"
        (objects / key).write_bytes(data)
        (out / file.name).symlink_to(f".git/annex/objects/{key}")
    return out


@pytest.mark.parametrize("source", ["youtube", "wiki", "reddit", "pairs", "links", "tasks"])
@pytest.mark.parametrize("layout", [hub, annex])
def test_a_release_of_links_is_a_release(
    folders: Path, here: Here, tmp_path: Path, source: str, layout: Callable[[Path, Path], Path]
) -> None:
    real, linked = folders / source, layout(folders / source, tmp_path / "cache")
    commands = [
        ("query", "--tables", "--json", "--data", "{at}"),
        ("status", "--json", "--data", "{at}"),
        ("verify", "--data", "{at}", "--json"),
    ]
    if source in ("youtube", "reddit", "pairs"):
        commands.append(("restore", "{at}", "--plan", "--json", "--data", "{at}/../new"))
    for words in commands:
        answers = [here(*(word.format(at=at) for word in words)) for at in (real, linked)]
        assert answers[0].code == answers[1].code == 0, (words, answers)
        said = [
            done.out.replace(str(at), "AT")
            for done, at in zip(answers, (real, linked), strict=True)
        ]
        assert said[0] == said[1]
    loaded, original = kb.load(linked), kb.load(real)
    for name in original.tables:
        assert loaded[name].to_table().equals(original[name].to_table())
        asked = f"FROM {name} ORDER BY ALL"
        assert loaded.sql(asked).to_table().equals(original.sql(asked).to_table())


@pytest.mark.parametrize("layout", [hub, annex])
def test_another_byte_behind_a_link_is_damage(
    folders: Path, here: Here, tmp_path: Path, layout: Callable[[Path, Path], Path]
) -> None:
    at = layout(folders / "reddit", tmp_path / "cache")
    shard = at / "posts-00000-of-00001.parquet"
    data = bytearray(shard.read_bytes())
    data[len(data) // 2] ^= 1
    shard.resolve().write_bytes(data)
    done = here("verify", "--data", str(at))
    assert done.code == 1
    assert f"damaged: {shard}: differs from {SUMS}" in done.out
    for words in (("query", "SELECT 1 FROM reddit_posts"), ("query", "--tables"), ("status",)):
        done = here(*words, "--data", str(at))
        assert done.code == 1
        assert done.said.startswith(f"kb: {shard} can't be read: checksum mismatch")


def test_a_link_that_leads_elsewhere_later_changes_nothing(folders: Path, tmp_path: Path) -> None:
    """What was compared is what is read, wherever the link leads by then."""
    at = hub(folders / "reddit", tmp_path / "cache")
    shard, secret = at / "posts-00000-of-00001.parquet", tmp_path / "secret.parquet"
    wanted = pq.read_table(shard)
    pq.write_table(wanted.slice(0, 1), secret)
    with views.connect(at) as con:
        read = scan([shard])
        shard.unlink()
        shard.symlink_to(secret)
        assert con.execute("SELECT count(*) FROM reddit_posts").fetchone() == (len(wanted),)
        assert str(secret) not in read
    for opened in (
        lambda: scan([shard]),
        lambda: parquet.open_file(shard),
        lambda: parquet.footer(shard),
    ):
        with pytest.raises(DamagedData, match="checksum mismatch"):
            opened()


def test_a_captured_file_outside_is_read_only_with_its_checksum(tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere" / "1" / "2"
    folder.mkdir(parents=True)
    (folder / "screenshot.png").write_bytes(b"a secret")
    (tmp_path / "root" / "raw" / "wiki").mkdir(parents=True)
    (tmp_path / "root" / "raw" / "wiki" / "pages").symlink_to(tmp_path / "elsewhere")
    path = "raw/wiki/pages/1/2/screenshot.png"
    for read in (stored_file, sidefiles.read_captured):
        with pytest.raises(DamagedData, match="leads out of the data root"):
            read(tmp_path / "root", path)
    sidefiles.write_sums(folder)
    assert (
        stored_file(tmp_path / "root", path)[0] == b"a secret"
    )  # no secret: the root describes it
    (folder / "screenshot.png").write_bytes(b"another")
    with pytest.raises(DamagedData, match="not what was stored"):
        stored_file(tmp_path / "root", path)


@pytest.mark.parametrize("what", ["raw", "raw/wiki", "raw/wiki/pages", "raw/wiki/pages/x.png"])
def test_no_link_shows_a_file_of_this_machine(tmp_path: Path, what: str) -> None:
    """A stranger's folder, release or data root, whose screenshots are links to /etc."""
    secret, names = tmp_path / "etc", ["raw", "wiki", "pages", "x.png"]
    below = Path(*names[len(what.split("/")) :])
    secret.mkdir()
    (secret / below).parent.mkdir(parents=True, exist_ok=True)
    target = secret / below if str(below) != "." else secret / "passwd"
    target.write_text("root:x:0:0")
    place = tmp_path / "down" / what
    place.parent.mkdir(parents=True)
    place.symlink_to(secret if str(below) != "." else target)
    with pytest.raises(DamagedData):
        stored_file(tmp_path / "down", "/".join(names))


def test_a_tar_that_is_a_link_is_read_by_what_describes_its_bytes(tmp_path: Path) -> None:
    home, elsewhere = tmp_path / "wiki", tmp_path / "elsewhere.tar"
    home.mkdir()
    (tmp_path / "1.png").write_bytes(b"picture")
    with tarfile.open(elsewhere, "w") as tar:
        tar.add(tmp_path / "1.png", "1.png")
    name = "screenshots-00000-of-00001.tar"
    (home / name).symlink_to(elsewhere)
    with pytest.raises(DamagedData, match="is a link"):
        stored_file(home, f"{name}/1.png")
    (home / SUMS).write_text(checksums.listed([home / name]))
    assert stored_file(home, f"{name}/1.png")[0] == b"picture"
    entry = {"tar": name, "member": "1.png", "offset": 512, "size": 7, "sha256": "0" * 64}
    (home / "index.ndjson").write_text(json.dumps(entry) + "\n")
    with pytest.raises(DamagedData, match="checksum mismatch"):
        stored_file(home, f"{name}/1.png")
