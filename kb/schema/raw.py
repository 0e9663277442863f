"""JSON Schemas of raw answers: what a service sends, held against what `schemas/raw/` declares.

Only a small part of JSON Schema 2020-12 is used (listed in schemas/README.md), so the walk below
is all it needs, names the path of each finding, and tells new keys from wrong ones.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.resources import folder

_TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "object": (dict,),
    "array": (list, tuple),
    "null": (type(None),),
}


_FREE: dict[str, Any] = {"additionalProperties": True}


@dataclass
class RawCheck:
    """`unknown`: paths of undeclared keys and how often; `problems`: one line each."""

    unknown: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


def kinds() -> list[str]:
    """Every declared kind, "<source>/<kind>"."""
    root = folder("schemas") / "raw"
    return sorted(f"{path.parent.name}/{path.stem}" for path in root.glob("*/*.json"))


@cache
def raw(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind. Raises UsageError that names the known ones."""
    path = folder("schemas") / "raw" / f"{kind}.json"
    if not path.is_file():
        raise UsageError(f"no raw kind {kind!r} in schemas/", hint=f"known: {', '.join(kinds())}")
    return _read(path)


def _read(path: Path) -> dict[str, Any]:
    """The schema in a file, with `$ref` to a file beside it put in its place."""
    try:
        schema: dict[str, Any] = _resolved(
            json.loads(path.read_text(encoding="utf-8")), path.parent
        )
    except (ValueError, OSError) as error:
        raise SchemaMismatch(f"{path}: not readable as JSON: {error}") from None
    return schema


def _resolved(node: Any, beside: Path) -> Any:
    if isinstance(node, list):
        return [_resolved(item, beside) for item in node]
    if not isinstance(node, dict):
        return node
    made = {key: _resolved(value, beside) for key, value in node.items() if key != "$ref"}
    if isinstance(node.get("$ref"), str):
        base = beside.parent if beside.name == "parts" else beside
        made = _read(base / node["$ref"]) | made
    return made


def at(kind: str, path: str) -> dict[str, Any] | None:
    """The sub-schema at a path such as "items[].snippet.title"; None when it is not declared.

    Free objects hold any.
    """
    node: dict[str, Any] | None = raw(kind)
    for step in re.findall(r"[^.\[\]]+|\[\d*\]", path):
        if node is None:
            return None
        if step.startswith("["):
            prefix, index = node.get("prefixItems", []), step[1:-1]
            node = prefix[int(index)] if index and int(index) < len(prefix) else node.get("items")
        else:
            node = node.get("properties", {}).get(
                step, _FREE if node.get("additionalProperties") else None
            )
    return node


def types(schema: dict[str, Any]) -> set[str]:
    """The JSON types that a sub-schema allows; an empty set allows all."""
    said = schema.get("type", [])
    return {said} if isinstance(said, str) else set(said)


def check(kind: str, response: Any) -> RawCheck:
    """Holds an answer against its schema: counts unknown keys, lists missing and retyped fields."""
    found = RawCheck()
    _walk(raw(kind), response, "", found)
    return found


def unknown_keys(kind: str, response: Any) -> Counter[str]:
    """Paths of undeclared keys and how often, and nothing else: many times faster than `check`."""
    found: Counter[str] = Counter()
    _keys(_shape(kind), response, "", found)
    return found


@cache
def _shape(kind: str) -> dict[str, Any]:
    return _outline(raw(kind)) or {}


def _outline(schema: dict[str, Any]) -> dict[str, Any] | None:
    """The parts of a schema that can hold keys: "keys" (each with its outline or None),
    or "items".
    """
    if "items" in schema and "properties" not in schema:
        below = _outline(schema["items"])
        return {"items": below} if below else None
    if "properties" not in schema or schema.get("additionalProperties"):
        return None
    return {"keys": {name: _outline(inner) for name, inner in schema["properties"].items()}}


def _keys(outline: dict[str, Any], value: Any, path: str, found: Counter[str]) -> None:
    if "items" in outline:
        for item in value if isinstance(value, list) else ():
            _keys(outline["items"], item, f"{path}[]", found)
    elif isinstance(value, dict):
        known = outline["keys"]
        for name, item in value.items():
            if name not in known:
                found[f"{path}.{name}" if path else name] += 1
            elif (below := known[name]) is not None:
                _keys(below, item, f"{path}.{name}" if path else name, found)


def _walk(schema: dict[str, Any], value: Any, path: str, found: RawCheck) -> None:
    place = path or "the answer"
    allowed = types(schema)
    if allowed and not any(_is(value, name) for name in allowed):
        found.problems.append(f"{place} is {_shown(value)}, not {' or '.join(sorted(allowed))}")
        return
    if "enum" in schema and value not in schema["enum"]:
        found.problems.append(f"{place} is {_shown(value)}, none of {schema['enum']}")
    if isinstance(value, str):
        if "pattern" in schema and not re.search(schema["pattern"], value):
            found.problems.append(
                f"{place} is {_shown(value)}, which does not match {schema['pattern']}"
            )
    elif isinstance(value, dict):
        inner = schema.get("properties", {})
        for name in schema.get("required", []):
            if name not in value:
                found.problems.append(f"{f'{path}.{name}' if path else name} is missing")
        for name, item in value.items():
            below = f"{path}.{name}" if path else name
            if name in inner:
                _walk(inner[name], item, below, found)
            elif not schema.get("additionalProperties"):
                found.unknown[re.sub(r"\[\d+\]", "[]", below)] += 1
    elif isinstance(value, list | tuple):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            found.problems.append(f"{place} has {len(value)} items")
        prefix, rest = schema.get("prefixItems", []), schema.get("items")
        for index, item in enumerate(value):
            below = prefix[index] if index < len(prefix) else rest
            if below:
                _walk(below, item, f"{path}[{index}]", found)


def _is(value: Any, name: str) -> bool:
    if isinstance(value, bool):
        return name == "boolean"
    return isinstance(value, _TYPES[name])


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=repr)
    return text if len(text) <= 60 else text[:57] + "..."


def pick(kind: str, data: Any) -> Any:
    """A copy of `data` with the declared keys only, for answers that hold more than may be kept.

    Values of another type than declared are left out as well, so nothing can slip in under a
    declared name.
    """
    return _pick(raw(kind), data)


def _pick(schema: dict[str, Any], value: Any) -> Any:
    if isinstance(value, dict):
        if schema.get("additionalProperties"):
            return value
        inner = schema.get("properties", {})
        fitting = (
            (name, item)
            for name, item in value.items()
            if name in inner and _fits(inner[name], item)
        )
        return {name: _pick(inner[name], item) for name, item in fitting}
    if isinstance(value, list | tuple):
        below = schema.get("items") or {}
        return [_pick(below, item) for item in value if _fits(below, item)]
    return value


def _fits(schema: dict[str, Any], value: Any) -> bool:
    allowed = types(schema)
    return not allowed or any(_is(value, name) for name in allowed)
