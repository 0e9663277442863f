"""A declared table as JSON Schema 2020-12: one row as `kb query --format json` prints it."""

from __future__ import annotations

from typing import Any

from kb.schema.tables import Table, table


def row_schema(declared: Table | str, *, released: bool = False) -> dict[str, Any]:
    """The JSON Schema of one row. Every column is there; nullable ones may be null."""
    declared = table(declared) if isinstance(declared, str) else declared
    properties = {}
    for column in declared.columns:
        if released and not column.released:
            continue
        schema = column.parsed.json()
        if column.nullable:
            schema = {"anyOf": [schema, {"type": "null"}]}
        properties[column.name] = schema | {"description": column.doc}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": declared.name,
        "description": declared.doc,
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
