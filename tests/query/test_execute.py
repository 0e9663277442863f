"""Damaged files are named, whatever part of a query meets them."""

from pathlib import Path

import pytest

from kb import query
from kb.artifacts import manifest
from kb.core.errors import DamagedData


def test_pages_that_are_broken_name_their_file_also_while_rows_stream(root: Path) -> None:
    file = root / "clean/youtube/videos/part-00001.parquet"
    data = bytearray(file.read_bytes())
    data[4:200] = b"\xff" * 196
    file.write_bytes(data)
    with (
        query.connect(root) as con,
        pytest.raises(DamagedData, match=r"part-00001\.parquet can't be read"),
    ):
        query.select(con, "FROM clean.youtube_videos", root=root).read_all()


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT count(*) FROM clean.youtube_videos",
        "SELECT max(title) FROM Youtube_Videos",
        "SUMMARIZE youtube_videos",
    ],
)
def test_a_changed_bit_never_changes_an_answer(root: Path, sql: str) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    manifest.record(root / "clean/youtube", "clean/youtube")
    with query.connect(root) as con:
        query.select(con, sql, root=root).read_all()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    with query.connect(root) as con:
        query.select(con, "FROM release.youtube_videos", root=root).read_all()  # another's files
        with pytest.raises(DamagedData, match=f"{path.name} can't be read: checksum mismatch"):
            query.select(con, sql, root=root).read_all()
