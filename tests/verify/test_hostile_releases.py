"""Folders that a stranger made: each command that reads one ends soon, with one line or without any
harm, in bounded memory.
"""

import json
import os
import resource
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.core.errors import DamagedData
from kb.reader.wiki_page import stored_png
from kb.store.damage import SMALL
from kb.store.tables.checksums import read_small
from tests.inprocess import Here

MEMORY = 300_000  # kB
DEEP = "[" * 200_000


def one(folder: Path, pattern: str) -> Path:
    return next(iter(sorted(folder.glob(pattern))))


def replaced(path: Path, make: Callable[[Path], object]) -> None:
    path.unlink(missing_ok=True)
    make(path)


def zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


def large(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(7 * SMALL)  # more than MEMORY


def many(folder: Path) -> None:
    for number in range(40):
        (folder / f"posts{number:03d}-00000-of-99999.parquet").touch()
    (folder / "posts-00000-of-99999.parquet").touch()


def offsets(folder: Path) -> None:
    lines = [
        {"tar": "screenshots-00000-of-00001.tar", "member": "a", "offset": 1e400, "size": 1},
        {"tar": "screenshots-00000-of-00001.tar", "member": "b", "offset": 10**30, "size": 10**30},
    ]
    (folder / "index.ndjson").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    (folder / "screenshots-00000-of-00001.tar").write_bytes(bytes(1024))
    (folder / "SHA256SUMS").unlink()


RELEASES: dict[str, Callable[[Path], object]] = {
    "sums are a device": lambda folder: replaced(folder / "SHA256SUMS", zeros),
    "sums are a pipe": lambda folder: replaced(folder / "SHA256SUMS", os.mkfifo),
    "sums are large": lambda folder: replaced(folder / "SHA256SUMS", large),
    "tombstones are a pipe": lambda folder: replaced(folder / "tombstones.ndjson", os.mkfifo),
    "tombstones are large": lambda folder: replaced(folder / "tombstones.ndjson", large),
    "tombstones are deep": lambda folder: (folder / "tombstones.ndjson").write_text(DEEP),
    "tombstones are numbers": lambda folder: (folder / "tombstones.ndjson").write_text("1e999\n"),
    "a shard is a device": lambda folder: replaced(one(folder, "posts-*.parquet"), zeros),
    "a shard is a pipe": lambda folder: replaced(one(folder, "posts-*.parquet"), os.mkfifo),
    "metadata is a pipe": lambda folder: replaced(folder / "croissant.json", os.mkfifo),
    "metadata is deep": lambda folder: (folder / "croissant.json").write_text(DEEP),
    "metadata is a list": lambda folder: (folder / "croissant.json").write_text('["distribution"]'),
    "profile is a pipe": lambda folder: replaced(folder / "profile.toml", os.mkfifo),
    "profile is large": lambda folder: replaced(folder / "profile.toml", large),
    "profile is deep": lambda folder: (folder / "profile.toml").write_text(f"a = {DEEP}"),
    "keywords are a pipe": lambda folder: replaced(folder / "keywords.tsv", os.mkfifo),
    "an index is one line": lambda folder: replaced(folder / "index.ndjson", large),
    "an index is a pipe": lambda folder: replaced(folder / "index.ndjson", os.mkfifo),
    "names count to 99,999": many,
    "offsets are endless": offsets,
}
COMMANDS = (
    ("verify", "{folder}"),
    ("query", "SELECT count(*) FROM reddit_posts", "--data", "{folder}"),
    ("restore", "{folder}", "--plan", "--data", "{place}/new"),
    ("status", "--data", "{folder}"),
    ("search", "a word", "--data", "{folder}"),
)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", RELEASES)
def test_a_strangers_folder_is_one_line(
    folders: Path, here: Here, tmp_path: Path, name: str
) -> None:
    RELEASES[name](folders / "reddit")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for words in COMMANDS:
        done = here(*(word.format(folder=folders / "reddit", place=tmp_path) for word in words))
        assert done.code in (0, 1, 2), (words, done)
        assert "unexpected" not in done.err, (words, done.err)
        assert "Traceback" not in done.err, (words, done.err)
        if words[0] == "verify":
            assert done.code == 1, done
            assert len(done.out.splitlines()) < 100
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY


def test_shards_that_are_absent_are_named_up_to_a_thousand() -> None:
    assert len(manifest.siblings({"a-00000-of-00300.parquet"})) == 300
    names = {f"a{number}-00007-of-99999.parquet" for number in range(3)}
    found = manifest.siblings(names)
    assert names <= found
    assert len(found) <= 3 * 1_002


@pytest.mark.parametrize("make", [zeros, os.mkfifo, large, Path.mkdir])
def test_what_is_read_as_a_whole_is_a_file_of_a_size(tmp_path: Path, make) -> None:
    make(tmp_path / "file")
    with pytest.raises(DamagedData, match="can't be read"):
        read_small(tmp_path / "file")


def member(kind: bytes, size: int = 0) -> tarfile.TarInfo:
    made = tarfile.TarInfo("1.png")
    made.type, made.size, made.linkname = kind, size, "1.png"
    return made


@pytest.mark.parametrize("how", ["link to itself", "packed", "huge"])
def test_a_tar_without_an_index_gives_files_alone(tmp_path: Path, how: str) -> None:
    path = tmp_path / "screenshots-00000-of-00001.tar"
    with tarfile.open(path, "w:gz" if how == "packed" else "w:") as tar:
        if how == "link to itself":
            tar.addfile(member(tarfile.SYMTYPE))
        else:
            tar.addfile(member(tarfile.REGTYPE))
    if how == "huge":
        data = bytearray(path.read_bytes())
        info = member(tarfile.REGTYPE, 10**10)
        data[:512] = info.tobuf()[:512]
        path.write_bytes(data)
    with pytest.raises(DamagedData, match=r"has no 1\.png"):
        stored_png(tmp_path, f"{path.name}/1.png")
