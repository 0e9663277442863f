"""A release folder whose row groups are small for their table, as those of a table of 1 GB are."""

import random
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from kb.store.artifact_registry import SUMS
from kb.store.tables.checksums import listed
from kb.store.tables.shard_writer import ShardWriter

ROWS = 400_000
GROUP = 2_000  # of a table of 1 GB a group is 1 part in 250 or less
SHARDS = [f"comments-{at:05d}-of-00002.parquet" for at in range(2)]


def write_comments(place: Path, make_rows: Callable[..., pa.Table]) -> Path:
    """Two shards of comments, each under a post of its own: k0000000, k0000001 …"""
    drawn = make_rows("reddit/comments", 1_000, released=True)
    numbers = pa.array(range(ROWS))
    ids = pc.binary_join_element_wise("k", pc.utf8_lpad(numbers.cast(pa.string()), 7, "0"), "")
    rows = drawn.take(pc.bit_wise_and(numbers, pa.scalar(511)))
    drawn_ids = random.Random(7).randbytes(ROWS * 16).hex()
    comments = pa.array(drawn_ids[at : at + 32] for at in range(0, len(drawn_ids), 32))
    rows = rows.set_column(rows.schema.get_field_index("comment_id"), "comment_id", comments)
    rows = rows.set_column(rows.schema.get_field_index("post_id"), "post_id", ids)
    for at, name in enumerate(SHARDS):
        with ShardWriter(
            place / name, "reddit/comments", released=True, in_order=True, group_rows=GROUP
        ) as writer:
            writer.add_rows(rows.slice(at * ROWS // 2, ROWS // 2))
    (place / "profile.toml").write_text("name = 'x'\n")
    (place / SUMS).write_text(listed(sorted(place.iterdir())))
    return place
