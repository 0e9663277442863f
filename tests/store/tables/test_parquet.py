"""Parquet and raw data whose bits change: told by the file's name, whoever reads them."""

import contextlib
import os
from dataclasses import replace
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts.purge_rows import RowLocation, drop_rows
from kb.core.errors import DamagedData, KbError
from kb.export import minedojo
from kb.filters.filter_run import run_clean
from kb.pairs.build import build
from kb.report.data import ReportData
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table
from tests import recipes
from tests.filters import full_root
from tests.filters.made import run_at
from tests.store import flips


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw data, clean tables, pairs and exports of ten videos."""
    root = tmp_path_factory.mktemp("flips") / "data"
    full_root.make(root)
    tombstones.add_tombstones(root, "youtube", [("gone", "named")])
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
    # A bit of a raw frame's header may mean nothing; every bit of a Parquet file is noticed.
    assert counts["told"] > 1_980
    assert flips.tried([path for path in found if path.suffix == ".parquet"], 500)[0] == {
        "told": 500
    }


def test_a_changed_bit_in_tombstones_loses_no_key(root: Path) -> None:
    path = root / "raw/youtube/tombstones.parquet"
    intact, keys = path.read_bytes(), tombstones.keys(root, "youtube")
    try:
        for place in range(0, len(intact), 3):
            flip(path, place)
            with contextlib.suppress(DamagedData):
                assert tombstones.keys(root, "youtube") == keys
            path.write_bytes(intact)
    finally:
        path.write_bytes(intact)


def test_every_page_has_a_checksum(root: Path, tmp_path: Path) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    copy = tmp_path / "copy.parquet"
    copy.write_bytes(path.read_bytes())
    flip(copy, pq.read_metadata(path).row_group(0).column(0).data_page_offset + 30)
    with pytest.raises(OSError, match="CRC checksum"):
        pq.read_table(copy, page_checksum_verification=True, partitioning=None)
    with pytest.raises(DamagedData, match="CRC checksum"):
        parquet.read_table(copy)
    with pytest.raises(DamagedData, match=r"copy\.parquet can't be read"):
        parquet.verify_files(copy)


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    rows = pa.table({"a": ["text"] * 5})
    for name in ("one", "two"):
        parquet.write_file(tmp_path / name, rows)
        assert parquet.read_table(tmp_path / name).equals(rows)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_file_without_any_checksum_is_known_by_its_bytes(tmp_path: Path) -> None:
    for name, text in (("a", b"1"), ("b", b"1"), ("c", b"2")):
        (tmp_path / name).write_bytes(text)
    a, b, c = (parquet.content_digest(tmp_path / name) for name in "abc")
    assert (a == b, a == c) == (True, False)


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
        lambda root: recipes.export(run_at(root), "youtube"),
    ),
    "pairs' export": (
        "pairs/pairs-*.parquet",
        lambda root: recipes.export(run_at(root), "pairs"),
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
    held = path.read_bytes()
    if damage == "bit":
        page = pq.read_metadata(path).row_group(0).column(0).data_page_offset
        flip(path, page + 30)
    else:
        path.write_bytes(held[: 0 if damage == "emptied" else len(held) // 2])
    try:
        with pytest.raises(DamagedData) as told:
            read(root)
    finally:
        path.write_bytes(held)
    assert f"{path} can't be read" in str(told.value)
    other = "restore it from a copy"  # a filter reads tombstones first
    assert told.value.hint.startswith(("run `kb ", other))
    assert "\n" not in str(told.value)
    assert read(root) is not None


def test_rows_that_go_through_duckdb_are_verified_too(root: Path, make_rows) -> None:
    rows = make_rows("reddit/posts", 200, post_id=[f"p{number:03d}" for number in range(200)])
    path = root / "clean/reddit/posts/part-00000.parquet"
    write_table(path, rows, "reddit/posts")
    column = pq.read_metadata(path).row_group(0).column(0)
    flip(path, column.data_page_offset + column.total_compressed_size // 2)
    with duckdb.connect() as con:  # by itself it does not look
        con.execute("SELECT count(post_id) FROM read_parquet(?)", [str(path)]).fetchall()
    with pytest.raises(KbError, match=r"part-00000\.parquet can't be read"):
        minedojo.reddit(run_at(root))
