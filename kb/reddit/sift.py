"""Posts and comments out of raw answers for a purge, without decoding the others.

As kb.reddit.strip takes them out; things without a key stay as they are written.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import msgspec
from msgspec import Raw

from kb.core.errors import DamagedData
from kb.reddit import tree
from kb.reddit.crossposts import repeats
from kb.reddit.strip import HOLDERS, of_thing, of_value, without_asked
from kb.store.purge_search import Holds
from kb.store.rawlog import Envelope

_LIST, _OBJECT = b"[{"
_THINGS = (tree.POST, tree.COMMENT, "more")


class _Kind(msgspec.Struct, gc=False):
    kind: Any = None


_kind = msgspec.json.Decoder(_Kind)
_items = msgspec.json.Decoder(list[Raw])
_fields = msgspec.json.Decoder(dict[str, Raw])


class Sift:
    """Takes full names out of envelopes whose answer is not decoded.

    `holds` says which bytes may have one of them. `crossposts` collects the bare ids of crossposts
    of a key, also where a purge that was cut off has stripped them.
    """

    def __init__(self, holds: Holds) -> None:
        self.crossposts: set[str] = set()
        self._holds = holds

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
        answer, changed = self._value(envelope.response, keys)
        if not changed and request is envelope.request:
            return envelope
        if kind == "dumps" and changed and not answer["data"]["children"]:
            return None
        return msgspec.structs.replace(envelope, request=request, response=answer)

    def _value(self, value: Raw, keys: Collection[str]) -> tuple[Any, bool]:
        """(value without the keys, whether it changed), as `of_value`; what did not change stays
        raw.
        """
        begin = memoryview(value)[0]
        if begin == _LIST:
            found: list[Any] = []
            changed = False
            for inner in _items.decode(value):
                if not self._holds(inner):
                    found.append(inner)
                    continue
                left, other = self._thing(inner, keys)
                changed |= other
                found += left
            return (found, True) if changed else (value, False)
        if begin != _OBJECT:
            return value, False
        fields = _fields.decode(value)
        after = fields.get("after")
        if after is not None and tree.named(msgspec.json.decode(after), keys):
            return self._decoded(value, keys, of_value)
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
            left, changed = self._decoded(value, keys, of_thing)
            return (left, True) if changed else ([value], False)
        left, changed = self._value(value, keys)
        return [left], changed

    def _decoded(self, value: Raw, keys: Collection[str], without: Any) -> tuple[Any, bool]:
        whole = msgspec.json.decode(value)
        self._note(whole, keys)
        left, changed = without(whole, keys)
        return (left, True) if changed else (value, False)

    def _note(self, answer: Any, keys: Collection[str]) -> None:
        posts = (thing.data for thing in tree.things(answer) if thing.kind == tree.POST)
        self.crossposts.update(str(post.get("id")) for post in posts if repeats(post, keys))
