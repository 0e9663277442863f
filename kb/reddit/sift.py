"""Posts and comments out of raw answers for a purge, without decoding the others.

As kb.reddit.strip takes them out; things without a key stay as they are written. Which things have
one is told by types that hold only the fields in which a name may stand; an answer of another form
is decoded thing by thing.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Literal

import msgspec
from msgspec import UNSET, Raw, UnsetType

from kb.core.errors import DamagedData
from kb.reddit import tree
from kb.reddit.crossposts import repeats
from kb.reddit.strip import HOLDERS, of_thing, of_value, without_asked
from kb.store.rawlog import Envelope

_LIST, _OBJECT = b"[{"
_THINGS = (tree.POST, tree.COMMENT, "more")
_CROSSPOST, _ESCAPED = b"crosspost_parent", b"\\u"  # what a record that repeats another one has


class _Listing(msgspec.Struct, gc=False):
    """Things, and none of the other fields in which `of_value` looks for some."""

    kind: Literal["Listing"]
    data: _Children
    after: UnsetType = UNSET
    json: UnsetType = UNSET
    things: UnsetType = UNSET
    children: UnsetType = UNSET
    replies: UnsetType = UNSET


class _Children(msgspec.Struct, gc=False):
    children: list[_Thing]
    after: Any = None
    data: UnsetType = UNSET
    json: UnsetType = UNSET
    things: UnsetType = UNSET
    replies: UnsetType = UNSET


class _Thing(msgspec.Struct, gc=False):
    kind: Literal["t3", "t1", "more"]
    data: _Data


class _Data(msgspec.Struct, gc=False):
    """The fields of a post, a comment or a stub in which `of_thing` looks for a name."""

    id: Any = None
    link_id: Any = None
    parent_id: Any = None
    children: Any = None
    crosspost_parent: Any = None
    crosspost_parent_list: list[_Parent] | None = None
    replies: _Listing | str | None = None


class _Parent(msgspec.Struct, gc=False):
    id: Any = None


class _Kind(msgspec.Struct, gc=False):
    kind: Any = None


_answer = msgspec.json.Decoder(list[_Listing] | _Listing)
_kind = msgspec.json.Decoder(_Kind)
_items = msgspec.json.Decoder(list[Raw])
_fields = msgspec.json.Decoder(dict[str, Raw])


class Sift:
    """Takes full names out of envelopes whose answer is not decoded.

    `crossposts` collects the bare ids of crossposts of a key, also where a purge that was cut off
    has stripped them.
    """

    def __init__(self) -> None:
        self.crossposts: set[str] = set()

    def __call__(self, kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
        """The envelope without the keys; the same object when it holds none, None when nothing is
        left. Raises DamagedData.
        """
        try:
            return self._envelope(kind, envelope, keys)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise DamagedData(f"a raw line is no envelope: {error}") from None

    def _envelope(self, kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
        request = without_asked(kind, envelope.request, keys)
        if request is None:
            self._note(msgspec.json.decode(envelope.response), keys)
            return None
        held = _held(envelope.response, keys)
        if held is None:
            answer, changed = self._value(envelope.response, keys)
        else:
            answer, changed = self._listings(envelope.response, held, keys)
        if not changed and request is envelope.request:
            return envelope
        if kind == "dumps" and changed and not answer["data"]["children"]:
            return None
        return msgspec.structs.replace(envelope, request=request, response=answer)

    def _listings(
        self, value: Raw, held: list[list[int]], keys: Collection[str]
    ) -> tuple[Any, bool]:
        """(answer without the keys, whether it changed); `held` are the places of the things that
        hold one, of each listing. What did not change stays raw.
        """
        if not any(held):
            return value, False
        single = memoryview(value)[0] == _OBJECT
        listings: list[Any] = [value] if single else _items.decode(value)
        changed = False
        for number, places in enumerate(held):
            if not places:
                continue
            fields: dict[str, Any] = _fields.decode(listings[number])
            data: dict[str, Any] = _fields.decode(fields["data"])
            found, at, other = list[Any](), 0, False
            things = _items.decode(data["children"])
            for place in places:
                left, goes = self._decoded(things[place], keys)
                found += things[at:place]
                found += left if goes else [things[place]]
                at, other = place + 1, other or goes
            if other:
                data["children"] = found + things[at:]
                listings[number] = {**fields, "data": data}
                changed = True
        if not changed:
            return value, False
        return (listings[0] if single else listings), True

    def _value(self, value: Raw, keys: Collection[str]) -> tuple[Any, bool]:
        """(value without the keys, whether it changed), as `of_value`; what did not change stays
        raw.
        """
        begin = memoryview(value)[0]
        if begin == _LIST:
            found: list[Any] = []
            changed = False
            for inner in _items.decode(value):
                left, other = self._thing(inner, keys)
                changed |= other
                found += left
            return (found, True) if changed else (value, False)
        if begin != _OBJECT:
            return value, False
        fields = _fields.decode(value)
        after = fields.get("after")
        if after is not None and tree.named(msgspec.json.decode(after), keys):
            whole = msgspec.json.decode(value)
            # Things may stand in it as in a listing, or as in an answer of morechildren.
            forms = [whole, {"kind": "Listing", "data": whole}, {"json": {"data": whole}}]
            self._note(forms, keys)
            return of_value(whole, keys)
        fresh: dict[str, Any] = {}
        for name in HOLDERS:
            if name in fields:
                inner, other = self._value(fields[name], keys)
                if other:
                    fresh[name] = inner
        return ({**fields, **fresh}, True) if fresh else (value, False)

    def _thing(self, value: Raw, keys: Collection[str]) -> tuple[list[Any], bool]:
        """What takes the place of one element of a list, and whether that is something else."""
        if memoryview(value)[0] == _OBJECT and _kind.decode(value).kind in _THINGS:
            left, changed = self._decoded(value, keys)
            return (left, True) if changed else ([value], False)
        left, changed = self._value(value, keys)
        return [left], changed

    def _decoded(self, value: Raw, keys: Collection[str]) -> tuple[list[Any], bool]:
        """What takes the place of a post, a comment or a stub, and whether that is something
        else.
        """
        whole, text = msgspec.json.decode(value), bytes(value)
        if _CROSSPOST in text or _ESCAPED in text:
            self._note(whole, keys)
        return of_thing(whole, keys)

    def _note(self, answer: Any, keys: Collection[str]) -> None:
        posts = (thing.data for thing in tree.things(answer) if thing.kind == tree.POST)
        self.crossposts.update(str(post.get("id")) for post in posts if repeats(post, keys))


def _held(answer: Raw, keys: Collection[str]) -> list[list[int]] | None:
    """Of each listing of an answer, the places of the things that hold a key; None where that can't
    be said: the answer has another form, or its next page stands behind a key.
    """
    try:
        seen = _answer.decode(answer)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    listings = seen if isinstance(seen, list) else [seen]
    if any(tree.named(one.data.after, keys) for one in listings):
        return None
    return [
        [place for place, thing in enumerate(one.data.children) if _holds(thing, keys)]
        for one in listings
    ]


def _holds(thing: _Thing, keys: Collection[str]) -> bool:
    """Whether a thing, or one below it, holds a key."""
    stack = [thing]
    while stack:
        one = stack.pop()
        data = one.data
        if one.kind == "more":
            stubs = tree.stub_ids({"children": data.children})
            if any(f"t1_{key}" in keys for key in stubs):
                return True
            if not stubs and tree.named(data.parent_id, keys):
                return True
            continue
        if f"{one.kind}_{data.id}" in keys:
            return True
        # A million times, so a call is made where there is something to look at.
        if data.link_id is not None and tree.named(data.link_id, keys):
            return True
        if data.crosspost_parent is not None and tree.named(data.crosspost_parent, keys):
            return True
        if data.crosspost_parent_list and any(
            f"t3_{parent.id}" in keys for parent in data.crosspost_parent_list
        ):
            return True
        if type(data.replies) is _Listing:
            if tree.named(data.replies.data.after, keys):
                return True
            stack += data.replies.data.children
    return False
