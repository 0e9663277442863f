"""How posts and comments leave a raw answer; the same for a purge and for what comes in after it.

With a post go its comments (their addresses hold its title), and what crossposts show of it.
Replies to a comment stay, in its place. Depth of recursion is that of one page, which Reddit ends
at ten replies.

Where keys stand in what was asked, and which fields a crosspost copies, `schemas/raw/reddit/` says
(`x-keys`, `x-copied-from`). The tree of an answer is walked here: `x-keys` knows lists whose
entries go, but not trees in which replies take the place of what goes and stubs count it.
"""

from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.reddit.parse import answer_tree
from kb.reddit.parse.answer_tree import PURGED, theirs
from kb.schema import raw
from kb.schema.answer_keys import asked
from kb.store.layout import parquet_files
from kb.store.rawlog.rawlog import Envelope, Request
from kb.store.tables import parquet
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import ShardWriter

HOLDERS = ("data", "json", "things", "children", "replies")  # fields in which things may be


def strip(kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
    """The envelope without the full names `keys`, and without what is theirs who asked to be left
    out; the same object when it holds none, None when nothing is left.
    """
    if own := theirs(envelope.response):
        left = _strip(kind, envelope, own)
        return left and _strip(kind, left, keys)
    return _strip(kind, envelope, keys)


def _strip(kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
    request = without_asked(kind, envelope.request, keys)
    if request is None:
        return None
    answer = _left_of(envelope.response, keys)
    if request is envelope.request and answer == envelope.response:
        return envelope
    if kind == "dumps" and not answer["data"]["children"]:
        return None
    return msgspec.structs.replace(envelope, request=request, response=answer)


def without(answer: Any, keys: Collection[str]) -> Any:
    """The answer without the full names `keys`, and without what is theirs who asked to be left
    out.
    """
    for names in (theirs(answer), keys):
        answer = _left_of(answer, names) if names else answer
    return answer


def without_asked(kind: str, request: Request, keys: Collection[str]) -> Request | None:
    """What was asked, without the keys; None when it was about them alone."""
    params = asked(f"reddit/{kind}", request.params, {"": keys})
    if params is None:
        return None
    endpoint = request.endpoint
    if kind == "comments" and f"t1_{params.get('comment')}" in keys:
        # What is left reads as a page of the post: another address, which no place can say.
        endpoint = f"comments/{params.get('article', '')}"
        params = {name: value for name, value in params.items() if name != "comment"}
    return request if params is request.params else Request(endpoint, params)


def _left_of(value: Any, keys: Collection[str]) -> Any:
    """A part of an answer without the keys."""
    if isinstance(value, list):
        return [left for inner in value for left in _in_place_of(inner, keys)]
    if not isinstance(value, dict):
        return value
    holders = (name for name in HOLDERS if isinstance(value.get(name), (dict, list)))
    left = {**value, **{name: _left_of(value[name], keys) for name in holders}}
    if answer_tree.named(value.get("after"), keys):
        # Reddit goes on behind any post that it knows.
        children = left.get("children")
        things = children if isinstance(children, list) else []
        data = [child.get("data") for child in things if isinstance(child, dict)]
        names = [child.get("name") for child in data if isinstance(child, dict)]
        left["after"] = names[-1] if names else None
    return left


def _in_place_of(value: Any, keys: Collection[str]) -> list[Any]:
    """What takes the place of one element of a list."""
    kind, data = (value.get("kind"), value.get("data")) if isinstance(value, dict) else (None, None)
    if kind == "more" and isinstance(data, dict):
        return _stubs(value, data, keys)
    if kind not in (answer_tree.POST, answer_tree.COMMENT) or not isinstance(data, dict):
        return [_left_of(value, keys)]
    if answer_tree.named(data.get("link_id"), keys):
        return []
    replies = _left_of(data.get("replies"), keys)
    if f"{kind}_{data.get('id')}" in keys or data.get("author") == PURGED:
        inner = replies.get("data") if isinstance(replies, dict) else None
        return (inner.get("children") or []) if isinstance(inner, dict) else []
    if "replies" in data:
        data = {**data, "replies": replies}
    return [{**value, "data": without_parent(data, keys) if repeats(data, keys) else data}]


def _stubs(value: dict[str, Any], data: dict[str, Any], keys: Collection[str]) -> list[Any]:
    """A stub without the comments that it stands for and are keys."""
    children = answer_tree.stub_ids(data)
    kept = [key for key in children if f"t1_{key}" not in keys]
    if not children:
        return [] if answer_tree.named(data.get("parent_id"), keys) else [value]
    if len(kept) == len(children):
        return [value]
    if not kept:  # without children it would mean "continue this thread"
        return []
    return [{**value, "data": {**data, "children": kept, "id": kept[0], "name": f"t1_{kept[0]}"}}]


_ADDRESS = r"/(?:comments|gallery)/(?P<key>[0-9a-z]+)"


@cache
def _copied() -> frozenset[str]:
    """The fields that Reddit copies from the parent.

    Addresses hold the title of a text post, and the id of a gallery.
    """
    post = raw.at("reddit/dumps", "data.children[].data") or {}
    fields = post.get("properties", {})
    return frozenset(name for name, declared in fields.items() if "x-copied-from" in declared)


def repeats(post: dict[str, Any], keys: Collection[str]) -> bool:
    """Whether a post's record repeats one of the full names `keys`."""
    parents = post.get("crosspost_parent_list")
    listed = parents if isinstance(parents, list) else ()
    return answer_tree.named(post.get("crosspost_parent"), keys) or any(
        isinstance(parent, dict) and f"t3_{parent.get('id')}" in keys for parent in listed
    )


def crossposts_of(answer: Any, keys: Collection[str]) -> set[str]:
    """The bare ids of the posts in an answer that repeat one of the full names `keys`."""
    posts = (thing.data for thing in answer_tree.things(answer) if thing.kind == answer_tree.POST)
    return {str(post.get("id")) for post in posts if repeats(post, keys)}


def without_parent(post: dict[str, Any], keys: Collection[str]) -> dict[str, Any]:
    """The record of a crosspost of one of `keys` without what it shows."""
    copied = _copied()
    left = {name: value for name, value in post.items() if name not in copied}
    if isinstance(listed := left.get("crosspost_parent_list"), list):
        left["crosspost_parent_list"] = [
            parent
            for parent in listed
            if not (isinstance(parent, dict) and f"t3_{parent.get('id')}" in keys)
        ]
    return left


def drop_parents(folder: Path, crossposts: Collection[str], keys: Collection[str]) -> None:
    """Take the parents `keys` out of a folder of reddit/posts. Raises DiskFull.

    `crossposts` are bare ids of those that are known to repeat a key; others are recognized by
    their address. Files without such rows are not touched.
    """
    known = pa.array(sorted(crossposts), pa.string())
    purged = pa.array(
        sorted(key.removeprefix("t3_") for key in keys if key.startswith("t3_")), pa.string()
    )

    def hit(rows: pa.RecordBatch) -> pa.BooleanArray:
        named = pc.struct_field(pc.extract_regex(_addresses(rows), _ADDRESS), "key")
        shown = pc.and_(rows["is_crosspost"], pc.is_in(named, value_set=purged))
        shown = pc.or_(shown, pc.is_in(rows["post_id"].cast(pa.string()), value_set=known))
        # One that was changed before, and the crosspost of a text, shows nothing.
        return pc.and_(shown, pc.not_equal(rows["type"].cast(pa.string()), "text"))

    columns = ["post_id", "type", "source_url", "is_crosspost"]
    _rewrite(folder, columns, hit, lambda rows: _bare(rows, hit(rows)))


def drop_hashes(folder: Path, people: Collection[str]) -> None:
    """Take what stands for people out of the addresses in a folder of reddit/posts. Raises
    DiskFull.
    """
    any_of = "|".join(sorted(people))

    def hit(rows: pa.RecordBatch) -> pa.BooleanArray:
        named = pc.match_substring_regex(_addresses(rows), any_of)
        hits: pa.BooleanArray = pc.fill_null(named, False)
        return hits

    def changed(rows: pa.RecordBatch) -> pa.RecordBatch:
        place = rows.schema.get_field_index("source_url")
        fresh = pc.replace_substring_regex(_addresses(rows), any_of, PURGED)
        return rows.set_column(place, "source_url", fresh)

    if people:
        _rewrite(folder, ["source_url"], hit, changed)


def _addresses(rows: pa.RecordBatch) -> Any:
    return rows["source_url"].cast(pa.string())


def _rewrite(
    folder: Path,
    columns: list[str],
    hit: Callable[[pa.RecordBatch], pa.BooleanArray],
    change: Callable[[pa.RecordBatch], pa.RecordBatch],
) -> None:
    """Write the files of reddit/posts again in which `hit`, which reads these columns, is true of
    a row.
    """
    for path in parquet_files(folder):
        with reading([path]), parquet.open_file(path) as file:
            if any(hit(batch).true_count for batch in file.iter_batches(columns=columns)):
                with ShardWriter(path, "reddit/posts", in_order=True) as writer:
                    for batch in file.iter_batches():
                        writer.add_rows(pa.Table.from_batches([change(batch)]))


def _bare(rows: pa.RecordBatch, hit: pa.BooleanArray) -> pa.RecordBatch:
    for name, value in (
        ("type", "text"),
        ("source_url", None),
        ("link_kind", None),
        ("poll_options", None),
    ):
        place, field = rows.schema.get_field_index(name), rows.schema.field(name)
        plain = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        column = rows[name].cast(plain)
        rows = rows.set_column(place, name, pc.if_else(hit, pa.scalar(value, plain), column))
    return rows
