"""Where an answer's keys stand, as `schemas/raw/` says it, and how they leave the answer.

A raw kind may carry `x-keys`, which names places in an answer and in what was asked for:

    "x-keys": {
      "whole":   [{"at": "video_id"}],               the answer is about this key alone
      "request": [{"at": "id", "split": ","}],       a parameter, and what stands between its keys
      "entries": [{"at": "items", "keys": [{"at": "id"}]}],      lists, and the keys of an entry
      "renamed": {"at": "query.normalized", "of": "title"}       other forms of what was asked for
    }

"contentDetails.videoId" is a field of a field, "revisions.0.revid" one of a list's first entry;
entries at "query.pages.redirects" are those of a list in each page. A place has besides:

    of      which names stand there, where a thing has others than its key ("title")
    prefix  what is put before the text to make a key of it ("t3_" before a bare id)
    stays   the answer stays when none of the parameter's keys is left: they are no whole of it
    beside  a parameter of as many entries, which belong to those of this one
    owner   a name that many entries share, as it is of who made them

An entry goes when one of its names is gone, and its other names but an owner's are gone with it in
this answer.
Names are compared as text.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache, partial
from typing import Any
from urllib.parse import unquote

import msgspec

from kb.core.errors import SchemaMismatch
from kb.schema.raw import raw

Params = dict[str, Any]
RemovedNames = Mapping[str, Collection[str]]  # by `of`; "" has the keys


class KeyLocation(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A place where names stand."""

    at: str
    of: str = ""
    prefix: str = ""
    split: str | None = None
    stays: bool = False
    owner: bool = False
    parallel: KeyLocation | None = msgspec.field(default=None, name="beside")

    def text(self, value: Any) -> str | None:
        """The name that `value` makes at this place; None when it is neither text nor a number."""
        if isinstance(value, bool) or not isinstance(value, (str, int)):
            return None
        return f"{self.prefix}{value}"

    def has(self, value: Any, removed: RemovedNames) -> bool:
        """Whether `value`, which stands here, is one of the names that go."""
        return self.text(value) in removed.get(self.of, ())


class Entries(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A list, and where its entries have their names."""

    at: str
    keys: tuple[KeyLocation, ...]


class Renamed(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A list of `from` and `to`: the form that was asked for, and the service's own.

    With `fromencoded` the former is written as in an address, as MediaWiki does.
    """

    at: str
    of: str


class KeyDeclaration(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What `x-keys` says of one raw kind."""

    subject: tuple[KeyLocation, ...] = msgspec.field(default=(), name="whole")
    request: tuple[KeyLocation, ...] = ()
    entries: tuple[Entries, ...] = ()
    renamed: Renamed | None = None


@cache
def keys_of(kind: str) -> KeyDeclaration:
    """Where the keys of a kind stand ("<source>/<kind>"); nowhere when it does not say.

    Raises SchemaMismatch when `x-keys` is not as described above, UsageError for an unknown kind.
    """
    try:
        return msgspec.convert(raw(kind).get("x-keys", {}), KeyDeclaration)
    except msgspec.ValidationError as error:
        raise SchemaMismatch(f"schemas/raw/{kind}.json: x-keys: {error}") from None


def without(
    kind: str, params: Params, response: Any, removed: RemovedNames
) -> tuple[Params, Any] | None:
    """A request and its answer without the names `removed`; None when nothing is left of them.

    What holds none of the names comes back as the same objects.
    """
    declared = keys_of(kind)
    if any(place.has(_at(response, place.at), removed) for place in declared.subject):
        return None
    removed = _with_other_names(declared, response, removed)
    left = asked(kind, params, removed)
    if left is None:
        return None
    for listed in declared.entries:
        response = _without(
            response, listed.at, partial(_goes, places=listed.keys, removed=removed)
        )
    if (renamed := declared.renamed) is not None:
        names = removed.get(renamed.of, ())
        response = _without(
            response, renamed.at, lambda change: not _forms(change).isdisjoint(names)
        )
    return left, response


def asked(kind: str, params: Params, removed: RemovedNames) -> Params | None:
    """What was asked, without the names; None when it asked for nothing else."""
    for place in keys_of(kind).request:
        fewer = _without_asked(params, place, removed)
        if fewer is None:
            return None
        params = fewer
    return params


def _without_asked(params: Params, place: KeyLocation, removed: RemovedNames) -> Params | None:
    value = params.get(place.at)
    if not value:
        return params
    if place.split is None:
        if not place.has(value, removed):
            return params
        return {**params, place.at: ""} if place.stays else None
    listed = value.split(place.split) if isinstance(value, str) else list(value)
    others = (params.get(place.parallel.at) or []) if place.parallel else []
    kept = [
        number
        for number, name in enumerate(listed)
        if not place.has(name, removed)
        and not (
            place.parallel and number < len(others) and place.parallel.has(others[number], removed)
        )
    ]
    if len(kept) == len(listed):
        return params
    if not kept and not place.stays:
        return None
    left = [listed[number] for number in kept]
    fewer = {**params, place.at: place.split.join(left) if isinstance(value, str) else left}
    if place.parallel and others:
        fewer[place.parallel.at] = [others[number] for number in kept if number < len(others)]
    return fewer


def _with_other_names(
    declared: KeyDeclaration, response: Any, removed: RemovedNames
) -> RemovedNames:
    """The names that go, with the other names that this answer gives to the same things."""
    others: dict[str, set[str]] = {}
    for listed in declared.entries:
        for entry in _listed(response, listed.at) if len(listed.keys) > 1 else []:
            if _goes(entry, listed.keys, removed):
                for place in listed.keys:
                    if not place.owner and (name := place.text(_at(entry, place.at))):
                        others.setdefault(place.of, set()).add(name)
    if (renamed := declared.renamed) is not None:
        names = {*removed.get(renamed.of, ()), *others.get(renamed.of, ())}
        for change in _listed(response, renamed.at):
            forms = _forms(change)
            if not names.isdisjoint(forms):
                others.setdefault(renamed.of, set()).update(forms)
    if not others:
        return removed
    return {of: {*removed.get(of, ()), *others.get(of, ())} for of in {*removed, *others}}


def _forms(change: Any) -> set[str]:
    """Both forms of a name that was asked for."""
    before, after = _at(change, "from"), _at(change, "to")
    if not isinstance(before, str) or not isinstance(after, str):
        return set()
    return {unquote(before) if change.get("fromencoded") else before, after}


def _goes(entry: Any, places: Iterable[KeyLocation], removed: RemovedNames) -> bool:
    return any(place.has(_at(entry, place.at), removed) for place in places)


def _listed(response: Any, at: str) -> list[Any]:
    value = _at(response, at)
    return value if isinstance(value, list) else []


def _without(value: Any, at: str, goes: Callable[[Any], bool]) -> Any:
    """The answer with a shorter list at a path, the same object when every entry stays.

    A list on the way stands for each of its entries.
    """
    if at and isinstance(value, list):
        entries = [_without(entry, at, goes) for entry in value]
        return value if all(map(operator.is_, entries, value)) else entries
    if not at:
        if not isinstance(value, list):
            return value
        left = [entry for entry in value if not goes(entry)]
        return value if len(left) == len(value) else left
    step, _, below = at.partition(".")
    if not isinstance(value, dict) or step not in value:
        return value
    left = _without(value[step], below, goes)
    return value if left is value[step] else {**value, step: left}


def _at(value: Any, path: str) -> Any:
    for step in path.split("."):
        if isinstance(value, list):
            value = value[int(step)] if step.isdigit() and int(step) < len(value) else None
        else:
            value = value.get(step) if isinstance(value, dict) else None
    return value
