"""A file of `schemas/tables/` as it is written: its blocks, and all that is wrong with it.

A file has the keys `name`, `doc`, `key`, `sort_by` (lists of columns), and optionally `released`;
then one `[[column]]` block a column (an `[[input]]` block has the same keys and stands for a value
that parsing reads and a later rule uses up: it is in no table):

    name        lower case with underscores
    type        see kb.schema.types
    unit        what a number counts ("s", "px", "views"); absent for text and ids
    null        why the value may be absent; without it the column is never null
    doc         one line
    from        "<raw kind>: <path>", "envelope: <field>", "annotation: <what>" or "rule: <how>"
    also        further raw kinds that have the value, each as in `from`
    released    true where the column goes into release/ (default false)
    content     true for what people wrote (titles, texts, addresses, names)
    dictionary  true for low-cardinality columns that Parquet stores with a dictionary
    values      the words that a text column may hold; the release gate refuses others. "<source>"
                stands for the name of every source
    pattern     a regular expression that each whole text of the column has; checked there as well
    each        a list of words; the block then stands for one column a word, put in place of {}
"""

import re
from typing import Any

from kb.core.sources import SOURCES
from kb.schema.types import parse_type

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_TABLE_KEYS = {
    "name",
    "doc",
    "key",
    "sort_by",
    "released",
    "column",
    "input",
}
_COLUMN_KEYS = {
    "name",
    "type",
    "unit",
    "null",
    "doc",
    "from",
    "also",
    "released",
    "content",
    "dictionary",
    "values",
    "pattern",
    "each",
}


def blocks(data: dict[str, Any], what: str) -> list[dict[str, Any]]:
    """The `[[column]]` or `[[input]]` blocks, one for each word of `each`."""
    problems: list[dict[str, Any]] = []
    for block in data.get(what, []):
        for word in block.get("each", [None]):
            fill = {k: _filled(v, word) if word else v for k, v in block.items() if k != "each"}
            if fill.get("values") == ["<source>"]:
                fill["values"] = list(SOURCES)
            problems.append(fill)
    return problems


def _filled(value: Any, word: str) -> Any:
    if isinstance(value, list):
        return [_filled(one, word) for one in value]
    return value.replace("{}", word) if isinstance(value, str) else value


def check_table(data: dict[str, Any]) -> list[str]:
    """Problems of one parsed TOML file, in its order; an empty list when it is right."""
    problems = [f"unknown key {key!r}" for key in data if key not in _TABLE_KEYS]
    for key in ("name", "doc"):
        if not isinstance(data.get(key), str) or not data[key].strip():
            problems.append(f"`{key}` is missing or empty")
    if not data.get("column"):
        return [*problems, "no [[column]]"]
    names: list[str] = []
    for number, block in enumerate(blocks(data, "column"), start=1):
        name = block.get("name", "")
        problems += [f"column {name or number}: {text}" for text in _column_problems(block)]
        if name in names:
            problems.append(f"column {name}: declared twice")
        names.append(name)
    for number, block in enumerate(blocks(data, "input"), start=1):
        name = block.get("name", "")
        problems += [f"input {name or number}: {text}" for text in _column_problems(block)]
        if name in names:
            problems.append(f"input {name}: there is a column of this name")
    for key in ("key", "sort_by"):
        if not isinstance(data.get(key), list) or not data[key]:
            problems.append(f"`{key}` must list columns")
        else:
            problems += [
                f"`{key}` names {name!r}, which is no column"
                for name in data[key]
                if name not in names
            ]
    return problems


def _column_problems(block: dict[str, Any]) -> list[str]:
    problems = [f"unknown key {key!r}" for key in block if key not in _COLUMN_KEYS]
    if not _NAME.fullmatch(str(block.get("name", ""))):
        problems.append("`name` must be lower case with underscores")
    doc = block.get("doc", "")
    if not isinstance(doc, str) or not doc.strip():
        problems.append("has no description (`doc`)")
    elif "\n" in doc:
        problems.append("`doc` must be one line")
    if not block.get("from"):
        problems.append("has no origin (`from`)")
    origins = [("from", block.get("from")), *(("also", one) for one in block.get("also", ()))]
    for key, origin in origins:
        kind, colon, path = str(origin).partition(":")
        if origin and not (colon and kind.strip() and path.strip()):
            problems.append(
                f"`{key}` is {origin!r}; it must read `<raw kind>: <path>` or `rule: <how>`"
            )
    if "null" in block and not str(block["null"]).strip():
        problems.append("`null` must say why the value may be absent")
    values = block.get("values", [""])
    if (
        not isinstance(values, list)
        or not values
        or not all(isinstance(word, str) for word in values)
    ):
        problems.append("`values` must list words")
    for key in ("values", "pattern"):
        if key in block and block.get("type") != "string":
            problems.append(f"`{key}` is for columns of type string")
    try:
        re.compile(str(block.get("pattern", "")))
    except re.error as error:
        problems.append(f"`pattern` is no regular expression: {error}")
    try:
        parse_type(str(block.get("type", "")))
    except ValueError as error:
        problems.append(str(error))
    return problems
