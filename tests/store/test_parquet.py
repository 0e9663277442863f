"""Parquet and raw data whose bits change: told by the file's name, whoever reads them."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts.purge_rows import RowLocation, drop_rows
from kb.core.errors import DamagedData, KbError
from kb.export import convokit
from kb.export import parquet as export
from kb.filters.clean import run_clean
from kb.pairs.build import build
from kb.report.data import ReportData
from kb.store import parquet, tombstones
from kb.store.shards import write_table
from tests.filters import full_root
from tests.filters.made import run_at
from tests.store import flips


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw data, clean tables, pairs and exports of ten videos."""
    root = tmp_path_factory.mktemp("flips") / "data"
    full_root.make(root)
    tombstones.add(root, "youtube", [("gone", "named")])
    return root


def flip(path: Path, place: int) -> None:
    """Change a bit of the byte at `place`; the file keeps its size and time."""
    data, about = bytearray(path.read_bytes()), path.stat()
    data[place] ^= 16
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns + 1))


def test_of_2000_changed_bits_in_raw_and_parquet_none_is_silent(root: Path) -> None:
    found = flips.files(root)
    assert {path.parent.name for path in found} >= {"videos", "transcripts", "rejected", "pairs"}
    counts, silent = flips.tried(found, 2_000)
    assert silent == []
    # A bit of a raw frame's header may mean nothing; all of a Parquet file is told.
    assert counts["told"] > 1_980
    assert counts.total() == 2_000
    assert flips.tried([path for path in found if path.suffix == ".parquet"], 500)[0] == {
        "told": 500
    }


def test_every_parquet_file_has_checksums_of_its_pages_and_of_itself(root: Path) -> None:
    found = list(root.rglob("*.parquet"))
    assert len(found) > 8
    for path in found:
        assert parquet.has_checksum(path), path
        assert parquet.holds(path)
    # The pages' own: a reader of others is told as well.
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    copy = root.parent / "copy.parquet"
    copy.write_bytes(path.read_bytes())
    flip(copy, pq.read_metadata(path).row_group(0).column(0).data_page_offset + 30)
    with pytest.raises(OSError, match="CRC checksum"):
        pq.read_table(copy, page_checksum_verification=True, partitioning=None)


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    rows = pa.table({"a": [parquet.KEY.decode() + "\x18\x0800000000"] * 5})  # as in the statistics
    for name in ("one", "two"):
        parquet.write(tmp_path / name, rows)
        assert parquet.read_table(tmp_path / name).equals(rows)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_footer_is_told_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    parquet.write(path, pa.table({"a": list(range(1_000))}))
    whole, length = path.read_bytes(), pq.read_metadata(path).serialized_size
    assert parquet.footer(path).num_rows == 1_000
    path.write_bytes(whole[:50] + bytes([whole[50] ^ 1]) + whole[51:])
    assert parquet.footer(path).num_rows == 1_000  # a page: nothing of it was read
    silent = []
    for place in range(len(whole) - length - 8, len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        try:
            parquet.footer(path)
        except (DamagedData, pa.ArrowException, OSError):
            continue
        silent.append(place)
    # The digits of the whole file's checksum are no part of the footer's own.
    assert len(silent) == 8
    assert whole[silent[0] - 2 - len(parquet.KEY) :].startswith(parquet.KEY)


def test_a_file_has_both_checksums_or_none(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    with pq.ParquetWriter(path, pa.schema([("a", pa.int64())])) as file:
        file.write_table(pa.table({"a": [1]}))
        file.add_key_value_metadata({parquet.KEY.decode(): "0" * 8})
    assert parquet.has_checksum(path)
    with pytest.raises(DamagedData, match="not those that were written"):
        parquet.footer(path)
    pq.write_table(pa.table({"a": [1]}), path)
    assert parquet.footer(path).num_rows == 1


def test_files_of_others_are_read_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"a": [1]}), path)
    assert not parquet.has_checksum(path)
    assert parquet.read_table(path).to_pylist() == [{"a": 1}]
    path.write_bytes(b"")
    parquet.check(path)
    with pytest.raises(pa.ArrowInvalid):
        parquet.open_file(path)


def test_a_file_that_was_replaced_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    parquet.write(path, pa.table({"a": [1]}))
    parquet.check(path)
    parquet.write(path, pa.table({"a": [2]}))
    parquet.check(path)
    flip(path, 20)
    with pytest.raises(DamagedData, match=r"a\.parquet can't be read: its bytes are not those"):
        parquet.check(path)


def _purged(root: Path) -> object:
    videos = RowLocation("clean/youtube/videos", "youtube/videos", "video_id")
    return list(drop_rows(root, [videos], {"x"}))


def _made_again(root: Path) -> object:
    return build(replace(run_at(root), again=True))


def _reported(root: Path) -> object:
    with ReportData(run_at(root)) as data:
        return data.count("youtube/videos")


READERS = {
    "filter": ("raw/youtube/tombstones.parquet", lambda root: run_clean(run_at(root), "youtube")),
    "pairs": ("clean/youtube/transcripts/part-*.parquet", _made_again),
    "export": (
        "clean/youtube/videos/part-*.parquet",
        lambda root: export.export(run_at(root), "youtube"),
    ),
    "pairs' export": (
        "pairs/pairs-*.parquet",
        lambda root: export.export(run_at(root), "pairs"),
    ),
    "purge": ("clean/youtube/videos/part-*.parquet", _purged),
    "report": ("clean/youtube/videos/part-*.parquet", _reported),
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("damage", ["bit", "emptied", "cut"])
def test_a_damaged_file_is_one_line_and_how_to_make_it_again(
    root: Path, name: str, damage: str
) -> None:
    pattern, read = READERS[name]
    path = next(iter(sorted(root.glob(pattern))))
    held, beside = path.read_bytes(), root / "state/youtube/tombstones.parquet"
    if damage == "bit":
        flip(path, len(held) // 2)
    else:
        path.write_bytes(held[: 0 if damage == "emptied" else len(held) // 2])
    try:
        with pytest.raises(DamagedData) as told:
            read(root)
    finally:
        path.write_bytes(held)
    assert f"{path} can't be read" in str(told.value)
    other = f"remove it: {beside} holds the purged keys as well"  # a filter reads them first
    assert told.value.hint.startswith("run `kb ") or told.value.hint == other
    assert "\n" not in str(told.value)
    assert beside.exists()
    assert read(root) is not None


def test_rows_that_go_through_duckdb_are_verified_too(root: Path, make_rows) -> None:  # type: ignore[no-untyped-def]
    rows = make_rows("reddit/posts", 200, post_id=[f"p{number:03d}" for number in range(200)])
    path = root / "clean/reddit/posts/part-00000.parquet"
    write_table(path, rows, "reddit/posts")
    column = pq.read_metadata(path).row_group(0).column(0)
    flip(path, column.data_page_offset + column.total_compressed_size // 2)
    with duckdb.connect() as con:  # by itself it does not look
        con.execute("SELECT count(post_id) FROM read_parquet(?)", [str(path)]).fetchall()
    with pytest.raises(KbError, match=r"part-00000\.parquet can't be read"):
        convokit.export(run_at(root))
