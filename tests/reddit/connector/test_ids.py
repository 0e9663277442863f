"""Lists of posts and comments in every form."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from kb.reddit.connector.ids import read_wanted


def test_ids_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "ids.txt").write_bytes(b"\xef\xbb\xbft3_a001\r\n")
    (tmp_path / "reddit.json").write_bytes(b'\xef\xbb\xbf[{"id": "a001"}]')
    assert list(read_wanted(tmp_path / "ids.txt").names) == ["t3_a001"]
    assert read_wanted(tmp_path / "reddit.json").trees == ["a001"]


def test_ids_of_released_tables_and_of_keys(tmp_path: Path) -> None:
    pq.write_table(pa.table({"comment_id": ["a1", "a2"], "post_id": ["p", "p"]}), tmp_path / "c")
    pq.write_table(pa.table({"post_id": ["p", "q"]}), tmp_path / "p.parquet")
    pq.write_table(
        pa.table({"key": ["t3_p", "t1_a"], "reason": ["x", "y"]}), tmp_path / "k.parquet"
    )
    assert list(read_wanted(tmp_path / "c").names) == ["t1_a1", "t1_a2"]
    assert list(read_wanted(tmp_path / "p.parquet").names) == ["t3_p", "t3_q"]
    assert list(read_wanted(tmp_path / "k.parquet").names) == ["t3_p", "t1_a"]
