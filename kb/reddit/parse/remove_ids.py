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
    answer, changed = of_value(envelope.response, keys)
    if not changed and request is envelope.request:
        return envelope
    if kind == "dumps" and not answer["data"]["children"]:
        return None
    return msgspec.structs.replace(envelope, request=request, response=answer)


def without(answer: Any, keys: Collection[str]) -> Any:
    """The answer without the full names `keys`, and without what is theirs who asked to be left
    out.
    """
    for names in (theirs(answer), keys):
        answer = of_value(answer, names)[0] if names else answer
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


def of_value(value: Any, keys: Collection[str]) -> tuple[Any, bool]:
    """(value without the keys, whether it changed); what did not change is the same object."""
    if isinstance(value, list):
        kept_values: list[Any] = []
        changed = False
        for inner in value:
            left, other = of_thing(inner, keys)
            changed |= other
            kept_values += left
        return (kept_values, True) if changed else (value, False)
    if not isinstance(value, dict):
        return value, False
    fresh: dict[str, Any] = {}
    for name in HOLDERS:
        if isinstance(value.get(name), (dict, list)):
            inner, other = of_value(value[name], keys)
            if other:
                fresh[name] = inner
    if answer_tree.named(value.get("after"), keys):
        # Reddit goes on behind any post that it knows.
        children = {**value, **fresh}.get("children")
        things = children if isinstance(children, list) else []
        data = [child.get("data") for child in things if isinstance(child, dict)]
        last = [one.get("name") for one in data if isinstance(one, dict)]
        fresh["after"] = last[-1] if last else None
    return ({**value, **fresh}, True) if fresh else (value, False)


def of_thing(value: Any, keys: Collection[str]) -> tuple[list[Any], bool]:
    """What takes the place of one element of a list, and whether that is something else."""
    data = value.get("data") if isinstance(value, dict) else None
    if not isinstance(data, dict) or value.get("kind") not in (
        answer_tree.POST,
        answer_tree.COMMENT,
        "more",
    ):
        left, changed = of_value(value, keys)
        return [left], changed
    if value["kind"] == "more":
        return _stub(value, data, keys)
    name = f"{value['kind']}_{data.get('id')}"
    if answer_tree.named(data.get("link_id"), keys):
        return [], True
    replies, changed = of_value(data.get("replies"), keys)
    if name in keys or data.get("author") == PURGED:
        inner = replies.get("data") if isinstance(replies, dict) else None
        return (inner.get("children") or []) if isinstance(inner, dict) else [], True
    fresh = {"replies": replies} if changed else {}
    if repeats(data, keys):
        data = without_parent(data, keys)
    return (
        ([{**value, "data": {**data, **fresh}}], True)
        if fresh or data is not value["data"]
        else ([value], False)
    )


def _stub(
    value: dict[str, Any], data: dict[str, Any], keys: Collection[str]
) -> tuple[list[Any], bool]:
    children = answer_tree.stub_ids(data)
    kept = [key for key in children if f"t1_{key}" not in keys]
    if not children:
        return ([], True) if answer_tree.named(data.get("parent_id"), keys) else ([value], False)
    if len(kept) == len(children):
        return [value], False
    # Without children it would mean "continue this thread".
    return (
        [{**value, "data": {**data, "children": kept, "id": kept[0], "name": f"t1_{kept[0]}"}}]
        if kept
        else []
    ), True


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
        isinstance(one, dict) and f"t3_{one.get('id')}" in keys for one in listed
    )


def crossposts_of(answer: Any, keys: Collection[str]) -> set[str]:
    """The bare ids of the posts in an answer that repeat one of the full names `keys`."""
    posts = (thing.data for thing in answer_tree.things(answer) if thing.kind == answer_tree.POST)
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
    return _rewrite(folder, columns, hit, lambda rows: _bare(rows, hit(rows)))


def drop_hashes(folder: Path, people: Collection[str]) -> int:
    """Take what stands for people out of the addresses in a folder of reddit/posts; how many rows
    changed. Raises DiskFull.
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

    return _rewrite(folder, ["source_url"], hit, changed) if people else 0


def _addresses(rows: pa.RecordBatch) -> Any:
    return rows["source_url"].cast(pa.string())


def _rewrite(
    folder: Path,
    columns: list[str],
    hit: Callable[[pa.RecordBatch], pa.BooleanArray],
    change: Callable[[pa.RecordBatch], pa.RecordBatch],
) -> int:
    """Write the files of reddit/posts again in which `hit`, which reads these columns, is true of
    a row; how many rows that are.
    """
    changed = 0
    for path in parquet_files(folder):
        with reading([path]), parquet.open_file(path) as file:
            hits = sum(hit(batch).true_count for batch in file.iter_batches(columns=columns))
            if not hits:
                continue
            with ShardWriter(path, "reddit/posts", in_order=True) as writer:
                for batch in file.iter_batches():
                    writer.write(pa.Table.from_batches([change(batch)]))
        changed += hits
    return changed


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
