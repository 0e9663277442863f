"""Crossposts whose parent was purged: their own title stays, what they show of the parent goes.

What is left is what the filter makes of a post whose content is gone: a text post without an
address.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.reddit.parse import tree
from kb.schema import raw
from kb.store import parquet
from kb.store.reading import reading
from kb.store.shards import ShardWriter

_ADDRESS = r"/(?:comments|gallery)/(?P<key>[0-9a-z]+)"


@cache
def _copied() -> frozenset[str]:
    """The fields that Reddit copies from the parent.

    Addresses hold the title of a text post, and the id of a gallery.
    """
    post = raw.at("reddit/dumps", "data.children[].data") or {}
    fields = post.get("properties", {})
    return frozenset(name for name, said in fields.items() if "x-copied-from" in said)


def repeats(post: dict[str, Any], keys: Collection[str]) -> bool:
    """Whether a post's record repeats one of the full names `keys`."""
    parents = post.get("crosspost_parent_list")
    listed = parents if isinstance(parents, list) else ()
    return tree.named(post.get("crosspost_parent"), keys) or any(
        isinstance(one, dict) and f"t3_{one.get('id')}" in keys for one in listed
    )


def crossposts_of(answer: Any, keys: Collection[str]) -> set[str]:
    """The bare ids of the posts in an answer that repeat one of the full names `keys`."""
    posts = (thing.data for thing in tree.things(answer) if thing.kind == tree.POST)
    return {str(post.get("id")) for post in posts if repeats(post, keys)}


def without_parent(post: dict[str, Any], keys: Collection[str]) -> dict[str, Any]:
    """The record of a crosspost of one of `keys` without what it shows; the same object when that
    is gone already.
    """
    listed = post.get("crosspost_parent_list")
    copied = _copied()
    if not listed and not copied & post.keys():
        return post
    left = {name: value for name, value in post.items() if name not in copied}
    if isinstance(listed, list):
        left["crosspost_parent_list"] = [
            one for one in listed if not (isinstance(one, dict) and f"t3_{one.get('id')}" in keys)
        ]
    return left


def drop_parents(folder: Path, crossposts: Collection[str], keys: Collection[str]) -> int:
    """Take the parents `keys` out of a folder of reddit/posts; how many rows changed. Raises
    DiskFull.

    `crossposts` are bare ids of those that are known to repeat a key; others are told by their
    address. Files without such rows are not touched.
    """
    known = pa.array(sorted(crossposts), pa.string())
    purged = pa.array(
        sorted(key.removeprefix("t3_") for key in keys if key.startswith("t3_")), pa.string()
    )

    def hit(rows: pa.RecordBatch) -> pa.BooleanArray:
        named = pc.struct_field(
            pc.extract_regex(rows["source_url"].cast(pa.string()), _ADDRESS), "key"
        )
        shown = pc.and_(rows["is_crosspost"], pc.is_in(named, value_set=purged))
        shown = pc.or_(shown, pc.is_in(rows["post_id"].cast(pa.string()), value_set=known))
        # One that was changed before, and the crosspost of a text, shows nothing.
        told: pa.BooleanArray = pc.and_(shown, pc.not_equal(rows["type"].cast(pa.string()), "text"))
        return told

    changed = 0
    for path in sorted(folder.glob("*.parquet")):
        with reading([path]), parquet.open_file(path) as file:
            hits = sum(
                hit(batch).true_count
                for batch in file.iter_batches(
                    columns=["post_id", "type", "source_url", "is_crosspost"]
                )
            )
            if not hits:
                continue
            with ShardWriter(path, "reddit/posts", in_order=True) as writer:
                for batch in file.iter_batches():
                    writer.write(_bare(pa.Table.from_batches([batch]), hit(batch)))
        changed += hits
    return changed


def _bare(rows: pa.Table, hit: pa.BooleanArray) -> pa.Table:
    for name, value in (
        ("type", "text"),
        ("source_url", None),
        ("link_kind", None),
        ("poll_options", None),
    ):
        place, field = rows.column_names.index(name), rows.schema.field(name)
        plain = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        column = rows[name].cast(plain)
        rows = rows.set_column(place, name, pc.if_else(hit, pa.scalar(value, plain), column))
    return rows
