"""JSON Schemas of raw answers: what `schemas/raw/` declares, and the keys that it does not know.

Only a small part of JSON Schema 2020-12 is used (listed in schemas/WRITING.md).
"""

import json
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.sources import SCHEMA_FOLDERS

_FREE: dict[str, Any] = {"additionalProperties": True}


def kinds() -> list[str]:
    """Every declared kind, "<source>/<kind>"."""
    paths = (path for root in SCHEMA_FOLDERS for path in (root / "raw").glob("*/*.json"))
    return sorted(f"{path.parent.name}/{path.stem}" for path in paths)


@cache
def raw(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind. Raises UsageError that names the known ones."""
    paths = (root / "raw" / f"{kind}.json" for root in SCHEMA_FOLDERS)
    path = next(filter(Path.is_file, paths), None)
    if path is None:
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


def _resolved(node: Any, folder: Path) -> Any:
    if isinstance(node, list):
        return [_resolved(item, folder) for item in node]
    if not isinstance(node, dict):
        return node
    made = {key: _resolved(value, folder) for key, value in node.items() if key != "$ref"}
    if isinstance(node.get("$ref"), str):
        base = folder.parent if folder.name == "parts" else folder
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
    allowed = schema.get("type", [])
    return {allowed} if isinstance(allowed, str) else set(allowed)


def unknown_keys(kind: str, response: Any) -> Counter[str]:
    """Paths of undeclared keys, as "items[].snippet.mood", and how often they stand there."""
    counts: Counter[str] = Counter()
    _keys(_shape(kind), response, "", counts)
    return counts


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


def _keys(outline: dict[str, Any], value: Any, path: str, counts: Counter[str]) -> None:
    if "items" in outline:
        for item in value if isinstance(value, list) else ():
            _keys(outline["items"], item, f"{path}[]", counts)
    elif isinstance(value, dict):
        known = outline["keys"]
        for name, item in value.items():
            if name not in known:
                counts[f"{path}.{name}" if path else name] += 1
            elif (below := known[name]) is not None:
                _keys(below, item, f"{path}.{name}" if path else name, counts)
