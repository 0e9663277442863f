"""Lists of posts and comments in every form."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.reddit.crawl.ids import read_wanted


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


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("https://www.reddit.com/r/potshop/comments/abc/a_title/?utm=t3_zzz", "t3_abc"),
        ("http://old.reddit.com/comments/abc", "t3_abc"),
        ("reddit.com/r/potshop/comments/abc/_/def?context=3#x", "t1_def"),
        ("HTTPS://WWW.REDDIT.COM/r/potshop/comments/abc/comment/def/", "t1_def"),
        ("/r/potshop/comments/abc/a_title/def/", "t1_def"),
        ("https://www.reddit.com/user/somebody/comments/abc/a_title", "t3_abc"),
        ("https://www.reddit.com/gallery/abc", "t3_abc"),
        ("https://redd.it/abc", "t3_abc"),
        ("https://example.org/r/potshop/comments/abc/a_title/", None),
        ("https://notreddit.com/comments/abc", None),
        ("https://www.reddit.com/user/somebody?u=/comments/abc/", None),
        ("https://www.reddit.com/r/potshop/comments/", None),
        ("https://www.reddit.com/r/potshop/s/abc", None),
        ("https://i.redd.it/abc.png", None),
    ],
)
def test_addresses(tmp_path: Path, text: str, key: str | None) -> None:
    (tmp_path / "ids.txt").write_text(f"t3_first\n{text}\n")
    wanted = read_wanted(tmp_path / "ids.txt")
    assert list(wanted.names) == ["t3_first", *([key] if key else [])]
    assert wanted.bad_lines == (key is None)
