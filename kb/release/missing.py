"""What `kb restore` could not bring back, of all sources → restored/missing.parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.schema import table
from kb.store import parquet
from kb.store.layout import Layout, parquet_files
from kb.store.shards import write_table


def write_missing(root: Path) -> int:
    """One table of the sources' own lists and of pairs without text; how many rows it has."""
    at = Layout(root)
    whole = pa.concat_tables([_videos(at), *_posts(at), *_texts(at)])
    write_table(at.restored() / "missing.parquet", whole, "shared/missing")
    return whole.num_rows


def _videos(at: Layout) -> pa.Table:
    """YouTube's list as it is, with plain texts; without rows where there is none."""
    path = at.restored("youtube") / "missing.parquet"
    schema = pa.schema([(name, pa.string()) for name in table("shared/missing").names()])
    if not path.is_file():
        return schema.empty_table()
    return parquet.read_table(path, columns=schema.names).cast(schema)


def _posts(at: Layout) -> list[pa.Table]:
    """Reddit's list; a full name says whether it is a post or a comment."""
    path = at.restored("reddit") / "missing.parquet"
    if not path.is_file():
        return []
    rows = parquet.read_table(path, columns=["key", "reason"])
    keys, reasons = (rows[name].cast(pa.string()) for name in ("key", "reason"))
    kinds = pc.if_else(pc.starts_with(keys, "t3_"), "post", "comment")
    return [_rows("reddit", kinds, keys, reasons)]


def _texts(at: Layout) -> list[pa.Table]:
    """Pairs without a text, and whether their video has a transcript at all."""
    ids = [
        parquet.read_table(path, columns=["video_id"])["video_id"].cast(pa.string())
        for path in parquet_files(at.restored("youtube", "transcripts"))
    ]
    there = pa.chunked_array([chunk for one in ids for chunk in one.chunks], pa.string())
    lists = []
    for path in parquet_files(at.restored("pairs")):
        rows = parquet.read_table(path, columns=["pair_id", "video_id", "text"])
        rows = rows.filter(pc.is_null(rows["text"]))
        has = pc.is_in(rows["video_id"].cast(pa.string()), value_set=there.combine_chunks())
        reasons = pc.if_else(has, "other transcript", "no transcript")
        kinds = pa.array(["text"] * rows.num_rows, pa.string())
        lists.append(_rows("pairs", kinds, rows["pair_id"].cast(pa.string()), reasons))
    return lists


def _rows(source: str, parts: Any, keys: Any, reasons: Any) -> pa.Table:
    of = pa.array([source] * len(keys), pa.string())
    return pa.table({"source": of, "part": parts, "key": keys, "reason": reasons})
