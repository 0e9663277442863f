"""Where an answer's keys stand, as `schemas/raw/` says it, and how they leave the answer.

A raw kind may carry `x-keys`:

    "x-keys": {
      "whole":   ["video_id"],           the answer is about this key alone
      "request": {"id": ","},            a parameter that lists keys, and what stands between them
      "entries": {"items": ["id"]}       a list of entries, and where each has its key
    }

A path such as "contentDetails.videoId" names one field; of several the first one that is there
counts. Keys are compared as text.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from typing import Any

import msgspec

from kb.core.errors import SchemaMismatch
from kb.schema.raw import raw

Params = dict[str, Any]


class Keys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What `x-keys` says of one raw kind."""

    whole: tuple[str, ...] = ()
    request: Mapping[str, str] = {}
    entries: Mapping[str, tuple[str, ...]] = {}


@cache
def keys_of(kind: str) -> Keys:
    """Where the keys of a kind stand ("<source>/<kind>"); nowhere when it does not say.

    Raises SchemaMismatch when `x-keys` is not as described above, UsageError for an unknown kind.
    """
    try:
        return msgspec.convert(raw(kind).get("x-keys", {}), Keys)
    except msgspec.ValidationError as error:
        raise SchemaMismatch(f"schemas/raw/{kind}.json: x-keys: {error}") from None


def without(
    kind: str, params: Params, response: Any, gone: Collection[str]
) -> tuple[Params, Any] | None:
    """A request and its answer without the keys `gone`; None when nothing is left of them.

    What holds none of the keys comes back as the same objects.
    """
    declared = keys_of(kind)
    if any(_text(_at(response, path)) in gone for path in declared.whole):
        return None
    for name, separator in declared.request.items():
        fewer = _without_asked(params, name, separator, gone)
        if fewer is None:
            return None
        params = fewer
    for place, paths in declared.entries.items():
        response = _without_entries(response, place.split("."), paths, gone)
    return params, response


def _without_asked(
    params: Params, name: str, separator: str, gone: Collection[str]
) -> Params | None:
    """The parameters without the keys; None when one of them asked for nothing else."""
    asked = params.get(name)
    if not asked:
        return params
    listed = asked.split(separator) if isinstance(asked, str) else list(asked)
    kept = [key for key in listed if _text(key) not in gone]
    if len(kept) == len(listed):
        return params
    if not kept:
        return None
    return {**params, name: separator.join(kept) if isinstance(asked, str) else kept}


def _without_entries(
    value: Any, place: list[str], paths: tuple[str, ...], gone: Collection[str]
) -> Any:
    """The answer with a shorter list at `place`, the same object when no entry goes."""
    if not isinstance(value, dict) or place[0] not in value:
        return value
    inner = value[place[0]]
    if len(place) > 1:
        left = _without_entries(inner, place[1:], paths, gone)
    elif isinstance(inner, list):
        left = [entry for entry in inner if _key(entry, paths) not in gone]
        left = inner if len(left) == len(inner) else left
    else:
        left = inner
    return value if left is inner else {**value, place[0]: left}


def _key(entry: Any, paths: tuple[str, ...]) -> str | None:
    found = (_text(_at(entry, path)) for path in paths)
    return next((key for key in found if key), None)


def _at(value: Any, path: str) -> Any:
    for step in path.split("."):
        value = value.get(step) if isinstance(value, dict) else None
    return value


def _text(value: Any) -> str | None:
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        return None
    return str(value)
