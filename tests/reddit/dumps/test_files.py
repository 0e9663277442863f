"""Dumps are found, decompressed and cut into lines; what is damaged is counted."""

import bz2
import gzip
import io
import json
import lzma
import random
import signal
import struct
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard

from kb.core.errors import LimitReached, SettingError
from kb.core.progress import LineProgress
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.dumps import files
from kb.reddit.dumps.cursor import cursors
from kb.reddit.dumps.files import DEEPEST, ReadProgress, memory
from kb.reddit.dumps.find_dumps import find_dumps
from kb.reddit.dumps.import_file import ImportJob, import_file
from kb.store.rawlog import rawlog
from kb.store.tables.checksums import digest
from tests import processes
from tests.reddit.dumped import (
    _IMPORT,
    archived,
    block,
    blocks,
    frame,
    imported,
    members,
    post,
    records,
    run_in,
    write,
    zstd,
)


def took(root: Path, files: list[Path], **options: Any) -> dict[str, Any]:
    return import_dumps(run_in(root, **options), files)


def joined(records: list[Any], end: bytes = b"\n") -> bytes:
    return b"".join(json.dumps(record).encode() + end for record in records)


def import_killed(root, dump, segments):
    """Import a dump, killed each time that there are so many `segments`, then to its end."""
    folder = rawlog.folder(root, "reddit", "dumps")
    for number in segments:
        child = processes.program(_IMPORT, dump, root)
        while child.poll() is None and len(list(folder.glob("*.zst"))) < number:
            time.sleep(0.001)
        child.send_signal(signal.SIGKILL)
        assert child.wait() in (0, -signal.SIGKILL), child.output()
    job = ImportJob(str(root), str(dump), "Minecraft", 0.0, float("inf"), 0, 60_000)
    assert import_file(job).done


def zipped(data: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("RS", data)
    return file.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        b"plain text\n",
        b"[1, 2]\n",
        b"\xff\xfe{\0",
        b"\x89PNG\r\n\x1a\n",
        b'{\n "id": "a",\n "title": "t"\n}\n',
    ],
)
def test_a_named_file_that_is_no_dump_is_wrong_usage(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.zst").write_bytes(data)
    with pytest.raises(SettingError, match=r"x\.zst is not a dump"):
        took(tmp_path / "data", [tmp_path / "x.zst"])
    with pytest.raises(SettingError, match="nowhere"):
        took(tmp_path / "data", [tmp_path / "nowhere"])
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("pack", "command"), [(bz2.compress, "bunzip2"), (lzma.compress, "unxz"), (zipped, "unzip")]
)
def test_what_unpacks_other_containers_is_named(tmp_path: Path, pack: Any, command: str) -> None:
    (tmp_path / "RS").write_bytes(pack(b'{"id": "a"}\n'))
    with pytest.raises(SettingError) as wrong:
        took(tmp_path / "data", [tmp_path / "RS"])
    assert command in wrong.value.hint


def test_folders_are_searched_and_other_files_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "dumps"
    data = joined(records(30))
    for name, made in {
        "comments/RC_2020-01.zst": zstd(data),
        "submissions/RS_2020-01.zst_blocks": blocks(data),
        "submissions/RS_2020-02": members(data),
        "mine.ndjson": data,
        "cut.zst": zstd(data)[:9],
        "SHA256SUMS": b"0123 *RC_2020-01.zst\n",
        "about.json": b'{"name": "Minecraft"}\n',
        "empty": b"",
        "backup.tar.gz": gzip.compress(b"ustar"),
        ".part": data,
    }.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(made)
    disk = tmp_path / "disk"
    (place / "comments").rename(disk)
    (disk / "lost+found").mkdir()
    (disk / "lost+found/mine.ndjson").write_bytes(data)
    (place / "comments").symlink_to(disk)
    (disk / "up").symlink_to(place)
    root = place / "data"  # the data root's own raw answers are no dumps
    run = run_in(root, progress=LineProgress())
    assert [file.name for file in find_dumps(run, [place]).files] == [
        "cut.zst",
        "mine.ndjson",
        "RC_2020-01.zst",
        "RS_2020-01.zst_blocks",
        "RS_2020-02",
    ]
    done = import_dumps(run, [place])
    assert (done["crawled"], done["foreign_files"], done["truncated_files"]) == (80, 5, 1)
    said = "skipped 5 files without posts: SHA256SUMS, about.json, backup.tar.gz, …"
    assert said in capsys.readouterr().err
    assert import_dumps(run, [place])["crawled"] == 0
    (tmp_path / "none").mkdir()
    with pytest.raises(SettingError, match="contains no dumps"):
        find_dumps(run, [tmp_path / "none"])


Pack = Callable[[bytes], bytes]


def plain(data: bytes) -> bytes:
    return data


PACKS = [plain, zstd, members, blocks]
each = pytest.mark.parametrize("pack", PACKS)


def raw(root: Path) -> list[Any]:
    """What an import wrote, but for the dump's name and place, which are the container's."""
    return [
        (envelope.fetched_at, envelope.response)
        for envelope in rawlog.envelopes(root, "reddit", "dumps")
    ]


@each
def test_every_container_is_known_by_its_content(tmp_path: Path, pack: Pack) -> None:
    """Under names that say something else, several in one command."""
    data = joined(records(700))
    (tmp_path / "a.gz").write_bytes(data)
    (tmp_path / "b.jsonl").write_bytes(pack(data))
    key = "0123456789abcdef" * 4
    for name in ("a.gz", "b.jsonl"):
        state = tmp_path / name[0] / "state"
        state.mkdir(parents=True)
        (state / "reddit.key").write_text(key)
        done = took(tmp_path / name[0], [tmp_path / name])
        assert (done["crawled"], done["lines"]) == (466, 700)
        assert (done["bad_lines"], done["truncated_files"]) == (0, 0)
    assert raw(tmp_path / "b") == raw(tmp_path / "a")
    for name in ("a.gz", "b.jsonl"):  # hashed to its end while it was read
        (noted,) = cursors(tmp_path / name[0]).values()
        assert noted.sha256 == digest(tmp_path / name)
    both = took(tmp_path / "c", [tmp_path / "a.gz", tmp_path / "b.jsonl"])
    assert both["crawled"] == (466 if pack is plain else 932)  # the very same bytes


@each
@pytest.mark.parametrize(
    ("start", "end", "last"),
    [
        (b"", b"\r\n", b"\r\n"),
        (b"\xef\xbb\xbf", b"\n", b"\n"),
        (b"", b"\n", b""),
        (b"\n ", b"\n", b"\n\n"),
    ],
    ids=["CRLF", "byte order mark", "no last line end", "blank lines"],
)
def test_line_ends_and_marks_change_nothing(
    tmp_path: Path, pack: Pack, start: bytes, end: bytes, last: bytes
) -> None:
    made = records(30)
    data = start + joined(made, end).removesuffix(end) + last
    (tmp_path / "x").write_bytes(pack(data))
    done = took(tmp_path, [tmp_path / "x"])
    assert [data["id"] for _, data in imported(tmp_path)] == [
        one["id"] for one in made if one["subreddit"] == "Minecraft"
    ]
    assert (done["bad_lines"], done["truncated_files"]) == (0, 0)


@each
def test_an_empty_dump_holds_nothing(tmp_path: Path, pack: Pack) -> None:
    (tmp_path / "x").write_bytes(pack(b""))
    done = took(tmp_path, [tmp_path / "x"])
    assert (done["crawled"], done["lines"], done["truncated_files"]) == (0, 0, 0)


@each
@pytest.mark.parametrize("cut", [1, 300, 9_000])
def test_a_file_that_is_cut_off_is_counted_and_completed_later(
    tmp_path: Path, pack: Pack, cut: int
) -> None:
    whole, place = pack(joined(records(900))), tmp_path / "x"
    if pack is plain:
        cut += 1  # without its last line end alone it is whole
    place.write_bytes(whole[:-cut])
    done = took(tmp_path, [place])
    assert done["truncated_files"] == 1
    assert 300 <= done["crawled"] < 601
    place.write_bytes(whole)
    assert took(tmp_path, [place])["truncated_files"] == 0
    assert len({data["id"] for _, data in imported(tmp_path)}) == 600


@each
def test_damage_in_the_middle_is_counted_and_never_fatal(tmp_path: Path, pack: Pack) -> None:
    """A checksum comes after its records, so wrong ones may be among those that were imported."""
    sent, dump = records(900), tmp_path / "x"
    whole = pack(joined(sent))
    middle = len(whole) * 2 // 3
    dump.write_bytes(whole[:middle] + b"\xff" * 40 + whole[middle + 40 :])
    done = took(tmp_path, [dump])
    assert done["truncated_files"] + done["bad_lines"] > 0
    assert done["crawled"] > 200
    dump.write_bytes(whole)
    done = took(tmp_path, [dump])
    assert (done["truncated_files"], done["bad_lines"]) == (0, 0)
    there = {(data["id"], data.get("selftext")) for _, data in imported(tmp_path)}
    assert there >= {
        (data["id"], data["selftext"]) for data in sent if data["subreddit"] == "Minecraft"
    }


@each
def test_a_limit_stops_anywhere_and_the_next_run_resumes(tmp_path: Path, pack: Pack) -> None:
    (tmp_path / "x").write_bytes(pack(joined(records(450))))
    for _ in range(2):
        with pytest.raises(LimitReached):
            took(tmp_path, [tmp_path / "x"], limit=130)
    assert took(tmp_path, [tmp_path / "x"])["crawled"] == 40
    assert len(imported(tmp_path)) == 300


@each
def test_a_killed_import_takes_each_record_once(tmp_path: Path, pack: Pack) -> None:
    dump = tmp_path / "x"
    dump.write_bytes(pack(joined(records(6_000, 300))))
    import_killed(tmp_path, dump, (1, 4))
    ids = [data["id"] for _, data in imported(tmp_path)]
    assert len(ids) == len(set(ids)) == 4_000


@each
def test_pieces_stay_small(tmp_path: Path, pack: Pack) -> None:
    """One letter 40 million times swells from a few KB in every container."""
    (tmp_path / "x").write_bytes(pack(joined([post("a")]) + b'{"b": "' + b"x" * 40_000_000))
    if pack is blocks:
        return  # a row comes whole: its block says where it ends
    sizes = [len(piece) for piece in files.pieces(tmp_path / "x", ReadProgress())]
    assert max(sizes) < 5_000_000
    assert sum(sizes) > 40_000_000


@pytest.mark.parametrize("last", [joined([post("b")]), b"{" + random.Random(1).randbytes(90)])
def test_a_last_frame_is_whole_or_cut_off(tmp_path: Path, last: bytes) -> None:
    """With its content compressed and as it is, and without a checksum."""
    behind = b"\x50\x2a\x4d\x18" + (5).to_bytes(4, "little") + b"-" * 5  # holds no content
    whole = [frame(joined([post("a")])), behind, zstandard.compress(last)]
    for number in range(1, 4):
        (tmp_path / "x").write_bytes(b"".join(whole[:number]))
        progress = ReadProgress()
        found = b"".join(files.pieces(tmp_path / "x", progress))
        assert found == joined([post("a")]) + (last if number == 3 else b"")
        assert not progress.truncated
    for cut in range(1, len(whole[-1]) - 3):
        (tmp_path / "x").write_bytes(b"".join(whole)[:-cut])
        progress = ReadProgress()
        found = b"".join(files.pieces(tmp_path / "x", progress))
        assert found in [joined([post("a")]) + last[:size] for size in range(len(last) + 1)]
        assert progress.problem == "the last frame is cut off"


def test_zeros_behind_the_last_gzip_member_are_padding(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(members(joined([post("a")])) + bytes(70_000))
    done = took(tmp_path, [tmp_path / "x"])
    assert (done["crawled"], done["truncated_files"]) == (1, 0)
    (tmp_path / "x").write_bytes(members(joined([post("a")])) + b"something else")
    assert took(tmp_path, [tmp_path / "x"])["truncated_files"] == 1


def test_a_block_that_would_fill_the_memory_is_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_LARGEST", 1 << 20)
    large = block([b"x" * 3_000_000])
    overlap = zstandard.compress(struct.pack("<5I", 2, 0, 700_000, 0, 700_000) + b"x" * 700_000)
    for data in (large, struct.pack("<I", len(overlap)) + overlap):
        (tmp_path / "x").write_bytes(block([json.dumps(post("a")).encode()]) + data)
        progress = ReadProgress()
        assert len(list(files.pieces(tmp_path / "x", progress))) == 1
        assert "damaged block" in progress.problem


def test_the_window_of_a_dump_counts(tmp_path: Path) -> None:
    wide, small = archived(tmp_path / "RS_a.zst", "aaa"), write(tmp_path / "b.zst", [post("bbb")])
    assert 1 << 31 <= memory(wide) < (1 << 31) + (1 << 28)
    assert memory(small) < 1 << 28
    behind = tmp_path / "c.zst"  # a frame without content comes first in some files
    behind.write_bytes(b"\x50\x2a\x4d\x18" + (5).to_bytes(4, "little") + b"-" * 5)
    with behind.open("ab") as file:
        file.write(wide.read_bytes())
    assert memory(behind) == memory(wide)


def test_objects_that_are_broken_inside_count_in_a_file_of_the_subreddit(tmp_path):
    dump = write(tmp_path / "RS.zst", [post("aaa"), b'{"id": broken}', b"garbage", post("bbb")])
    assert import_dumps(run_in(tmp_path), [dump])["bad_lines"] == 2


@pytest.mark.parametrize("innermost", [b"", b"0"])
@pytest.mark.parametrize("depth", [199, 200, 300, 3_000, 200_000])
def test_a_line_nested_without_end_is_damaged(tmp_path, depth, innermost):
    lists = b"[" * depth + innermost + b"]" * depth
    record = b'{"id": "q", "subreddit": "Minecraft", "title": "t", "x": ' + lists + b"}"
    summary = import_dumps(run_in(tmp_path), [write(tmp_path / "RS.zst", [record, post("good")])])
    # The record itself is one level.
    bad = int(1 + depth > DEEPEST)
    assert (summary["crawled"], summary["bad_lines"]) == (2 - bad, bad)


@pytest.mark.parametrize("last", [False, True])
def test_a_line_without_end_is_not_held_and_counts_as_damaged(tmp_path, monkeypatch, last):
    """One of 1.8 GB swells from a small file."""
    monkeypatch.setattr(files, "LONGEST", 300_000)
    long = b'{"subreddit": "Minecraft", "id": "' + b"x" * 40_000_000
    lines = [post("a"), long, *([] if last else [post("b")])]
    dump = write(tmp_path / "RS.zst", lines, frames=len(lines))
    held = max_held(files.chunks(dump, files.ReadProgress()))
    assert held < 5_000_000
    assert max(len(piece) for piece in files.pieces(dump, files.ReadProgress())) < 5_000_000
    done = import_dumps(run_in(tmp_path), [dump])
    assert (done["lines"], done["bad_lines"]) == (len(lines), 1)
    assert [data["id"] for _, data in imported(tmp_path)] == ["a"] + ["b"] * (not last)


def max_held(chunks):
    return max(len(chunk.data) for chunk in chunks)
