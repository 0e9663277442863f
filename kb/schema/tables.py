"""Tables as declared in `schemas/tables/<source>/<table>.toml`.

A file has the keys `name`, `doc`, `key`, `sort_by` (lists of columns), and optionally `raw` (the
raw kind that rows come from), `partition_by` (a column) and `released`; then one `[[column]]`
block a column (an `[[input]]` block has the same keys and stands for a value that parsing reads
and a later rule uses up: it is in no table):

    name        lower case with underscores
    type        see kb.schema.types
    unit        what a number counts ("s", "px", "views"); absent for text and ids
    null        why the value may be absent; without it the column is never null
    doc         one line
    from        "<raw kind>: <path>", "envelope: <field>", "annotation: <what>" or "rule: <how>"
    released    true where the column goes into release/ (default false)
    content     true for what people wrote (titles, texts, addresses, names)
    dictionary  true for low-cardinality columns that Parquet stores with a dictionary
    values      the words that a text column may hold; the release gate refuses others
    pattern     a regular expression that each whole text of the column has; checked there as well
    each        a list of words; the block then stands for one column a word, put in place of {}
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.resources import folder
from kb.schema.types import Type, parse_type

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_TABLE_KEYS = {
    "name",
    "doc",
    "raw",
    "key",
    "sort_by",
    "partition_by",
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
    "released",
    "content",
    "dictionary",
    "values",
    "pattern",
    "each",
}


@dataclass(frozen=True)
class Origin:
    """Where a value comes from: `kind` is a raw kind, "envelope", "annotation" or "rule"."""

    kind: str
    path: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}"


@dataclass(frozen=True)
class Column:
    name: str
    type: str
    unit: str
    doc: str
    source: Origin
    why_null: str = ""
    released: bool = False
    content: bool = False
    dictionary: bool = False
    values: tuple[str, ...] = ()
    pattern: str = ""
    parsed: Type = field(repr=False, compare=False, default=None)  # type: ignore[assignment]

    @property
    def nullable(self) -> bool:
        return bool(self.why_null)


@dataclass(frozen=True)
class Table:
    """A declared table. `name` is "<source>/<table>"."""

    name: str
    doc: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]
    sort_by: tuple[str, ...]
    raw: str = ""
    partition_by: str = ""
    released: bool = False
    inputs: tuple[Column, ...] = ()

    @property
    def source(self) -> str:
        return self.name.partition("/")[0]

    @property
    def short(self) -> str:
        """The name without its source: "videos"."""
        return self.name.partition("/")[2]

    @cached_property
    def _by_name(self) -> dict[str, Column]:
        return {column.name: column for column in self.columns}

    def column(self, name: str) -> Column:
        """The column `name`; SchemaMismatch when it is not declared."""
        try:
            return self._by_name[name]
        except KeyError:
            raise SchemaMismatch(
                f"{self.name} has no column {name!r}",
                hint=f"declare it in schemas/tables/{self.name}.toml",
            ) from None

    def names(self, released: bool = False) -> list[str]:
        return [column.name for column in self.columns if column.released or not released]

    def arrow(self, released: bool = False) -> pa.Schema:
        """The Arrow schema, with each column's doc, unit and origin as field metadata."""
        return _arrow(self, released)


@cache
def _arrow(declared: Table, released: bool) -> pa.Schema:

    fields = []
    for column in declared.columns:
        if released and not column.released:
            continue
        about = {"doc": column.doc, "unit": column.unit, "from": str(column.source)}
        if column.nullable:
            about["null"] = column.why_null
        metadata = {key: value for key, value in about.items() if value}
        fields.append(pa.field(column.name, column.parsed.arrow(), column.nullable, metadata))
    return pa.schema(fields, metadata={"table": declared.name, "doc": declared.doc})


@cache
def tables() -> dict[str, Table]:
    """Every declared table by name, in the order of their names."""
    root = folder("schemas") / "tables"
    found = {}
    for path in sorted(root.glob("*/*.toml")):
        declared = load_table(path)
        expected = f"{path.parent.name}/{path.stem}"
        if declared.name != expected:
            raise SchemaMismatch(
                f"{path}: `name` is {declared.name!r}, the file's place says {expected!r}"
            )
        found[declared.name] = declared
    return found


def table(name: str) -> Table:
    """The table "<source>/<table>". Raises UsageError that names the known ones."""
    try:
        return tables()[name]
    except KeyError:
        raise UsageError(
            f"no table {name!r} in schemas/", hint=f"known: {', '.join(tables())}"
        ) from None


def load_table(path: Path) -> Table:
    """Reads one TOML file. Raises SchemaMismatch that lists every problem of the file at once."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SchemaMismatch(f"{path}: not readable as TOML: {error}") from None
    problems = check_table(data)
    if problems:
        raise SchemaMismatch(f"{path}: " + "; ".join(problems))
    columns = tuple(_column(block) for block in _expanded(data, "column"))
    inputs = tuple(_column(block) for block in _expanded(data, "input"))
    plain = {
        key: data[key] for key in ("name", "doc", "raw", "partition_by", "released") if key in data
    }
    return Table(
        columns=columns,
        inputs=inputs,
        key=tuple(data["key"]),
        sort_by=tuple(data["sort_by"]),
        **plain,
    )


def _expanded(data: dict[str, Any], what: str) -> list[dict[str, Any]]:
    blocks: list[dict[str, Any]] = []
    for block in data.get(what, []):
        for word in block.get("each", [None]):
            fill = {
                k: v.replace("{}", word) if word and isinstance(v, str) else v
                for k, v in block.items()
            }
            fill.pop("each", None)
            blocks.append(fill)
    return blocks


def _column(block: dict[str, Any]) -> Column:
    kind, _, path = block["from"].partition(":")
    return Column(
        name=block["name"],
        type=block["type"],
        unit=block.get("unit", ""),
        doc=block["doc"],
        source=Origin(kind.strip(), path.strip()),
        why_null=block.get("null", ""),
        released=block.get("released", False),
        content=block.get("content", False),
        dictionary=block.get("dictionary", False),
        values=tuple(block.get("values", ())),
        pattern=block.get("pattern", ""),
        parsed=parse_type(block["type"]),
    )


def check_table(data: dict[str, Any]) -> list[str]:
    """Problems of one parsed TOML file, in its order; an empty list when it is right."""
    problems = [f"unknown key {key!r}" for key in data if key not in _TABLE_KEYS]
    for key in ("name", "doc"):
        if not isinstance(data.get(key), str) or not data[key].strip():
            problems.append(f"`{key}` is missing or empty")
    if not data.get("column"):
        return [*problems, "no [[column]]"]
    names: list[str] = []
    for number, block in enumerate(_expanded(data, "column"), start=1):
        name = block.get("name", "")
        problems += [f"column {name or number}: {text}" for text in _column_problems(block)]
        if name in names:
            problems.append(f"column {name}: declared twice")
        names.append(name)
    for number, block in enumerate(_expanded(data, "input"), start=1):
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
    partition = data.get("partition_by", "")
    if partition and partition not in names:
        problems.append(f"`partition_by` names {partition!r}, which is no column")
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
    kind, colon, path = str(block.get("from", "")).partition(":")
    if not block.get("from"):
        problems.append("has no origin (`from`)")
    elif not colon or not kind.strip() or not path.strip():
        problems.append(
            f"`from` is {block['from']!r}; it must read `<raw kind>: <path>` or `rule: <how>`"
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
