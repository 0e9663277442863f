"""Folders that a stranger made: each command that reads one ends soon, with its exit code and one
line, or without any harm, in bounded memory.
"""

import json
import os
import re
import resource
import socket
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb
from kb.artifacts import manifest, release_folder
from kb.artifacts.stored_files import stored_file
from kb.core.errors import DamagedData
from kb.release.gate import tables
from kb.store.artifact_registry import SUMS
from kb.store.damage import SMALL
from kb.store.tables.checksums import listed, read_small
from tests.inprocess import Here

MEMORY = 300_000  # kB
DEEP = "[" * 200_000
AGAIN = "; download it again, into the same folder"


class Replaced(NamedTuple):
    """A file of a release in place of which something else is there."""

    name: str
    make: Callable[[Path], object]

    def __call__(self, folder: Path) -> None:
        (folder / self.name).unlink(missing_ok=True)
        self.make(folder / self.name)


def link(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(content)


def large(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(7 * SMALL)  # more than MEMORY


def bound(path: Path) -> None:
    """A socket; its path may be too long for an address."""
    folder = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(f"/proc/self/fd/{folder}/{path.name}")
    os.close(folder)


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
    (folder / SUMS).unlink()


def undescribed(folder: Path) -> None:
    Replaced(POSTS, link("/etc/passwd"))(folder)
    sums = (folder / SUMS).read_text()
    (folder / SUMS).write_text("".join(x for x in sums.splitlines(True) if POSTS not in x))


POSTS, GONE, INDEX = "posts-00000-of-00001.parquet", "tombstones.ndjson", "index.ndjson"
PROFILE, WORDS, ABOUT = "profile.toml", "keywords.tsv", "croissant.json"
DIFFERS, UNREAD = f"differs from {SUMS}", "can't be read: "
DEVICE, FIFO, SOCKET = (f"it is a {kind}, not a file" for kind in ("device", "FIFO", "socket"))
# What is damaged → what `kb verify` says of which file, then the line (and exit code, where it is
# not 1) of other commands. One that is not named ends with 0.
Line = str | tuple[int, str]
CASES: dict[str, tuple[Callable[[Path], object], str, dict[str, Line]]] = {
    **{
        f"sums are {what}": (
            Replaced(SUMS, make),
            f"damaged: {{at}}/{SUMS}: {said}",
            {"restore": f"{{at}}/{SUMS} is not a list of checksums"},
        )
        for what, make, said in (
            ("a device", link("/dev/zero"), DEVICE),
            ("a pipe", os.mkfifo, FIFO),
            ("a socket", bound, SOCKET),
            ("large", large, "is not a list of checksums"),
            ("/etc/passwd", link("/etc/passwd"), "is not a list of checksums"),
        )
    },
    **{
        f"a shard is {what}": (
            Replaced(POSTS, make),
            f"damaged: {{at}}/{POSTS}: {said}",
            dict.fromkeys(("query", "status"), f"{{at}}/{POSTS} {UNREAD}{read}")
            | {"restore": f"{{at}}/{POSTS} {restored}"},
        )
        for what, make, said, read, restored in (
            ("a device", link("/dev/zero"), DEVICE, DEVICE, f"{UNREAD}{DEVICE}"),
            ("a pipe", os.mkfifo, FIFO, FIFO, f"{UNREAD}{FIFO}"),
            ("a socket", bound, SOCKET, SOCKET, f"{UNREAD}{SOCKET}"),
            ("/etc/passwd", link("/etc/passwd"), DIFFERS, "checksum mismatch", DIFFERS),
        )
    },
    "a shard leads nowhere": (
        Replaced(POSTS, link("nowhere")),
        f"missing: {{at}}/{POSTS}: is a link that leads nowhere",
        dict.fromkeys(("query", "restore"), f"{{at}}/{POSTS} is missing")
        | {"status": f"{{at}}/{POSTS} {UNREAD}No such file or directory"},
    ),
    "nothing describes a link": (
        undescribed,
        f"foreign: {{at}}/{POSTS}: a release is flat, with files of its own",
        dict.fromkeys(
            ("query", "restore"),
            f"{{at}}/{POSTS} {UNREAD}it is a link, and {SUMS} does not describe it",
        ),
    ),
    **{
        f"tombstones are {what}": (
            Replaced(GONE, make),
            f"damaged: {{at}}/{GONE}: {said}",
            {"query": f"{{at}}/{GONE}{read}", "restore": f"{{at}}/{GONE} {restored}"},
        )
        for what, make, said, read, restored in (
            ("a pipe", os.mkfifo, FIFO, f" {UNREAD}{FIFO}", f"{UNREAD}{FIFO}"),
            ("large", large, DIFFERS, f" {UNREAD}it has more than 50,000,000 bytes", DIFFERS),
            ("deep", text(DEEP), DIFFERS, f": line 1 {UNREAD}depth limit", DIFFERS),
            ("numbers", text("1e999\n"), DIFFERS, f": line 1 {UNREAD}number is inf", DIFFERS),
            ("a list", text("[1]\n"), DIFFERS, f": line 1 {UNREAD}'list' object", DIFFERS),
            (
                "without reasons",
                text('{"key": "a", "source": "reddit", "removed_at": "2026-01-01"}\n'),
                DIFFERS,
                f": line 1 {UNREAD}column reason is missing or no text",
                DIFFERS,
            ),
            ("/etc/passwd", link("/etc/passwd"), DIFFERS, f" {UNREAD}checksum mismatch", DIFFERS),
        )
    },
    **{
        f"metadata is {what}": (
            Replaced(ABOUT, make),
            f"damaged: {{at}}/{ABOUT}: {said}",
            {"restore": f"{{at}}/{ABOUT} {restored}"},
        )
        for what, make, said, restored in (
            ("a pipe", os.mkfifo, FIFO, f"{UNREAD}{FIFO}"),
            ("deep", text(DEEP), "is not valid metadata", DIFFERS),
            ("a list", text('["distribution"]'), "is not valid metadata", DIFFERS),
        )
    },
    **{
        f"{name} is {what}": (
            Replaced(name, make),
            f"damaged: {{at}}/{name}: {said}",
            dict.fromkeys(("restore", "search"), line),
        )
        for name, what, make, said, line in (
            (PROFILE, "a pipe", os.mkfifo, FIFO, f"{{at}}/{PROFILE} {UNREAD}{FIFO}"),
            (
                *(PROFILE, "large", large, DIFFERS),
                (2, f"profile {{at}}/{PROFILE} {UNREAD}it has more than 10,000,000 bytes"),
            ),
            (
                *(PROFILE, "deep", text(f"a = {DEEP}"), DIFFERS),
                (2, f"profile {{at}}/{PROFILE} is nested too deeply"),
            ),
            (
                *(PROFILE, "/etc/passwd", link("/etc/passwd"), DIFFERS),
                f"{{at}}/{PROFILE} {UNREAD}checksum mismatch",
            ),
            (WORDS, "a pipe", os.mkfifo, FIFO, f"{{at}}/{WORDS} {UNREAD}{FIFO}"),
            (
                *(WORDS, "/etc/passwd", link("/etc/passwd"), DIFFERS),
                f"{{at}}/{WORDS} {UNREAD}checksum mismatch",
            ),
        )
    },
    "an index is one line": (Replaced(INDEX, large), f"foreign: {{at}}/{INDEX}: is not in", {}),
    "an index is a pipe": (Replaced(INDEX, os.mkfifo), f"foreign: {{at}}/{INDEX}: is not in", {}),
    "names count to 99,999": (
        many,
        "missing: {at}: 40,990 more files: is not there",
        {
            "query": "{at}/posts-00001-of-99999.parquet is missing (and 40,999 more files)",
            "restore": "{at}/posts-00001-of-99999.parquet is missing (and 40,999 more files)",
            "status": "{at}/posts-00000-of-99999.parquet can't be read: Parquet file size is 0",
        },
    ),
    "offsets are endless": (
        offsets,
        f"damaged: {{at}}/screenshots-00000-of-00001.tar: {INDEX} beside it can't be read",
        {"restore": f"{{at}} has no {SUMS}, so its files can't be checked"},
    ),
}
NO_TEXTS = (2, "nothing to search: {at} has no texts of")
COMMANDS = {
    "query": (
        "SELECT count(*), (SELECT count(*) FROM reddit_tombstones) FROM reddit_posts",
        *("--data", "{at}"),
    ),
    "restore": ("{at}", "--plan", "--data", "{place}/new"),
    "status": ("--data", "{at}"),
    "search": ("a word", "--data", "{at}"),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", CASES)
def test_a_strangers_folder_is_one_line(
    folders: Path, here: Here, tmp_path: Path, name: str
) -> None:
    damage, finding, lines = CASES[name]
    at = folders / "reddit"
    damage(at)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = here("verify", str(at))
    assert done.code == 1
    assert finding.format(at=at) in done.out
    assert len(done.out.splitlines()) < 100
    assert done.said.startswith(f"kb: {at} has problems: ")
    for command, words in COMMANDS.items():
        done = here(command, *(word.format(at=at, place=tmp_path) for word in words))
        expected = lines.get(command, NO_TEXTS if command == "search" else (0, ""))
        code, line = (1, expected) if isinstance(expected, str) else expected
        assert done.code == code, (command, done)
        assert done.said.startswith(f"kb: {line.format(at=at)}" if line else ""), (command, done)
        assert done.said or not line
        assert "root:" not in done.out + done.err  # of /etc/passwd
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY


def changed(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """A shard with other rows or columns, and checksums that describe them."""
    pq.write_table(change(pq.read_table(path)), path)
    sums = path.parent / SUMS
    lines = [line for line in sums.read_text().splitlines(True) if path.name not in line]
    sums.write_text("".join(lines) + listed([path]))


def put(rows: pa.Table, name: str, values: Any) -> pa.Table:
    return rows.set_column(rows.column_names.index(name), name, values)


def nested(rows: pa.Table, name: str) -> pa.Table:
    values = pa.StructArray.from_arrays([rows[name].combine_chunks()], [name])
    return put(rows, name, values)


COLUMNS: dict[str, tuple[Callable[[pa.Table, str], pa.Table], str]] = {
    "missing": (lambda rows, name: rows.drop_columns([name]), "is missing"),
    "twice": (lambda rows, name: rows.append_column(name, rows[name]), "is there twice"),
    "twice for DuckDB": (
        lambda rows, name: rows.add_column(0, name.upper(), rows[name]),
        "is there twice",
    ),
    "of another type": (
        lambda rows, name: put(rows, name, pa.nulls(len(rows), pa.date32())),
        "is date32[day], not ",
    ),
    "nested": (nested, "is struct<"),
}
KEYS = (
    ("youtube", "videos", "youtube_videos", "video_id"),
    ("wiki", "pages", "wiki_pages", "page_id"),
    ("wiki", "elements", "wiki_elements", "x"),
    ("reddit", "comments", "reddit_comments", "comment_id"),
    ("pairs", "pairs", "pairs", "video_id"),
    ("pairs", "quality", "pairs_quality", "language"),
    ("links", "links", "links.links", "key"),
    ("links", "entities", "entities", "aliases"),
    ("tasks", "tasks", "tasks", "task_id"),
)
RESTORED = ("youtube", "reddit", "pairs")


@pytest.mark.parametrize(("source", "short", "view", "column"), KEYS)
def test_columns_are_compared_before_anything_is_read(
    folders: Path, here: Here, tmp_path: Path, source: str, short: str, view: str, column: str
) -> None:
    at = folders / source
    path = min(at.glob(f"{short}-0*.parquet"))
    intact = path.read_bytes()
    for change, said in COLUMNS.values():
        path.write_bytes(intact)
        changed(path, lambda rows, change=change: change(rows, column))
        wanted = f"{path} can't be read: column {column} {said}"
        with pytest.raises(DamagedData, match=re.escape(wanted)):
            kb.load(at)[view].head()
        commands = [("query", f"SELECT 1 FROM {view}"), ("query", "--tables"), ("status",)]
        if source in RESTORED and short != "quality":
            commands.append(("restore", str(at), "--plan"))
        for words in commands:
            place = tmp_path / "new" if words[0] == "restore" else at
            done = here(*words, "--data", str(place))
            assert (done.code, done.said[: len(wanted) + 4]) == (1, f"kb: {wanted}"), (words, done)
            assert done.said.endswith(AGAIN)


NUMBERS = (
    ("wiki", "pages", "device_pixel_ratio", float("nan"), "nan, which is not from 0.1 to 16"),
    ("wiki", "pages", "device_pixel_ratio", float("inf"), "inf, which is not from 0.1 to 16"),
    ("wiki", "pages", "device_pixel_ratio", -1.0, "-1.0, which is not from 0.1 to 16"),
    ("wiki", "pages", "page_height", 2**62, "4,611,686,018,427,387,904, which is not from 1 to"),
    ("wiki", "elements", "y", float("nan"), "nan, which is not from -10,000,000 to 10,000,000"),
    (
        *("wiki", "elements", "lines"),
        [{"x": 1.0, "y": float("-inf"), "width": 1.0, "height": 1.0}],
        "-inf, which is not from",
    ),
    ("youtube", "videos", "duration_s", -1, "-1, which is not from 0 to 100,000,000"),
    ("youtube", "videos", "fetched_at", 2**61, "a time that is of no year from 1 to 9999"),
    ("pairs", "pairs", "clip_start_s", float("nan"), "nan, which is not from 0 to"),
    ("reddit", "posts", "upvote_ratio", 1.5, "1.5, which is not from 0 to 1"),
    ("links", "links", "count", -5, "-5, which is not from 0 to"),
    ("tasks", "tasks", "start_s", float("inf"), "inf, which is not from 0 to"),
)


@pytest.mark.parametrize(("source", "short", "column", "value", "said"), NUMBERS)
def test_numbers_outside_their_range_are_one_line(
    folders: Path, here: Here, source: str, short: str, column: str, value: Any, said: str
) -> None:
    at = folders / source
    path = min(at.glob(f"{short}-0*.parquet"))

    def odd(rows: pa.Table) -> pa.Table:
        kind = rows.schema.field(column).type
        plain = pa.int64() if pa.types.is_timestamp(kind) else kind
        values = pa.array([value] * len(rows), plain)
        return put(rows, column, values.cast(kind))

    changed(path, odd)
    wanted = f"{path} can't be read: column {column} holds {said}"
    declared = next(
        p.table for p in release_folder.read_release_folder(at, source).parts if path in p.shards
    )
    name = {"pairs": "pairs", "tasks": "tasks", "links": "links.links"}.get(
        short, f"{source}_{short}"
    )
    done = here("query", f"SELECT 1 FROM {name}", "--data", str(at))
    assert done.code == 1
    assert done.said.startswith(f"kb: {wanted}")
    with pytest.raises(DamagedData, match=re.escape(wanted)):
        kb.load(at)[name].to_table()
    problems, readable = tables.check(release_folder.read_release_folder(at, source))
    assert [one.what for one in problems if f"column {column} holds {said}" in one.what]
    assert declared not in [one.table for one in readable]


def test_shards_that_are_absent_are_named_up_to_a_thousand() -> None:
    assert len(manifest.siblings({"a-00000-of-00300.parquet"})) == 300
    names = {f"a{number}-00007-of-99999.parquet" for number in range(3)}
    found = manifest.siblings(names)
    assert names <= found
    assert len(found) <= 3 * 1_002


@pytest.mark.parametrize("make", [link("/dev/zero"), bound, os.mkfifo, large, Path.mkdir])
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
        stored_file(tmp_path, f"{path.name}/1.png")
