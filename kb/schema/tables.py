"""Tables as declared in `schemas/tables/<source>/<table>.toml`: in types, and in Arrow's.

A file has the keys of `Table`, then one `[[column]]` block a column with the keys of `Column`. An
`[[input]]` block has the same keys and stands for a value that parsing reads and a later rule uses
up: it is in no table. A block with `each`, a list of words, stands for one column a word, put in
place of {}; `values = ["<source>"]` stands for the name of every source, `["<part>"]` for what
their texts are called in links.

Types: `string | bool | int32 | int64 | float32 | float64 | date | timestamp[us, UTC]`,
`list<TYPE>` and `struct<NAME: TYPE, …>`, nested at will.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import msgspec
import pyarrow as pa
from msgspec import Meta

from kb.core.cached_property import cached_property
from kb.core.errors import SchemaMismatch, UsageError
from kb.core.sources import PARTS, SCHEMA_FOLDERS, SOURCES

WHEN_READ = frozenset({"fetched_at", "counted_at"})
"""Columns that say when a row was read: another time alone is no change of it."""

KEYED_HASHES = frozenset({"author_hash"})
"""Columns of hashes with a key of each data root: another key gives others of the same names."""

Text = Annotated[str, Meta(pattern=r"\S")]
Line = Annotated[str, Meta(pattern=r"^[^\n]*\S[^\n]*$")]
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]

_NAMES = {"<source>": tuple(SOURCES), "<part>": PARTS}

# name → (Arrow factory's name, Croissant data type)
_PLAIN: dict[str, tuple[str, str]] = {
    "string": ("string", "sc:Text"),
    "bool": ("bool_", "sc:Boolean"),
    "int32": ("int32", "sc:Integer"),
    "int64": ("int64", "sc:Integer"),
    "float32": ("float32", "sc:Float"),
    "float64": ("float64", "sc:Float"),
    "date": ("date32", "sc:Date"),
    "timestamp[us, UTC]": ("timestamp", "sc:DateTime"),
}


class Origin(str):
    """Where a value comes from, "<kind>: <path>": `kind` is a raw kind, "envelope", "annotation" or
    "rule".
    """

    __slots__ = ()

    @property
    def kind(self) -> str:
        return self.partition(":")[0].strip()

    @property
    def path(self) -> str:
        return self.partition(":")[2].strip()


def _origin(_: Any, text: Any) -> Origin:
    """For msgspec. Raises ValueError."""
    made = Origin(text)
    if not (made.kind and made.path):
        raise ValueError(f"{text!r} must read `<raw kind>: <path>` or `rule: <how>`")
    return made


class Column(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, dict=True):
    """A column of a table.

    type        as `parse_type` reads it
    unit        what a number counts ("s", "px", "views"); absent for text and ids
    doc         one line
    from        "<raw kind>: <path>", "envelope: <field>", "annotation: <what>" or "rule: <how>"
    null        why the value may be absent; without it the column is never null
    released    true where the column goes into release/
    content     true for what people wrote (titles, texts, addresses, names)
    dictionary  true for low-cardinality columns that Parquet stores with a dictionary
    values      the words that a text column may hold; the release gate refuses others
    words       what people read in place of a value, by value; one without reads as it is
    pattern     a regular expression that each whole text of the column has; checked there as well
    range       the smallest and the largest number of the column, also within lists and structs;
                the release gate and every reader of a release refuse others (NaN is none)
    also        further raw kinds that have the value, each as in `from`
    """

    name: Name
    type: str
    unit: str = ""
    doc: Line
    source: Origin = msgspec.field(name="from")
    why_null: Text = msgspec.field(name="null", default="")
    released: bool = False
    content: bool = False
    dictionary: bool = False
    values: Annotated[tuple[str, ...], Meta(min_length=1)] = ()
    words: tuple[tuple[str, Line], ...] = ()
    pattern: str = ""
    range: tuple[float, float] | None = None
    also: tuple[Origin, ...] = ()

    def __post_init__(self) -> None:
        """Raises ValueError."""
        parse_type(self.type)
        if (self.values or self.pattern) and self.type != "string":
            raise ValueError("`values` and `pattern` are for columns of type string")
        if self.values and (unknown := [word for word, _ in self.words if word not in self.values]):
            raise ValueError(f"`words` name {', '.join(unknown)}, not in `values`")
        try:
            re.compile(self.pattern)
        except re.error as error:
            raise ValueError(f"`pattern` is not a regular expression: {error}") from None
        if self.range is not None and not re.search("int|float", self.type):
            raise ValueError("`range` is for columns of numbers")
        if self.range is not None and not self.range[0] <= self.range[1]:
            raise ValueError("`range` names the smallest number first")

    @cached_property
    def parsed(self) -> Type:
        return parse_type(self.type)

    @property
    def nullable(self) -> bool:
        return bool(self.why_null)

    def origin(self, kind: str) -> Origin | None:
        """Where an answer of the raw kind has the value; None where it has none."""
        return next((place for place in (self.source, *self.also) if place.kind == kind), None)


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, dict=True):
    """A declared table. `name` is "<source>/<table>"; `key` and `sort_by` name columns.

    `split_by` names a column with few values, after which the files of a release are named, and
    not after the table: a split for training each.
    """

    name: Text
    doc: Text
    columns: Annotated[tuple[Column, ...], Meta(min_length=1)] = msgspec.field(name="column")
    key: Annotated[tuple[str, ...], Meta(min_length=1)]
    sort_by: Annotated[tuple[str, ...], Meta(min_length=1)]
    released: bool = False
    split_by: str = ""
    inputs: tuple[Column, ...] = msgspec.field(name="input", default=())

    def __post_init__(self) -> None:
        """Raises ValueError."""
        names = Counter(column.name for column in (*self.columns, *self.inputs))
        if twice := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"declared twice: {', '.join(twice)}")
        if unknown := {*self.key, *self.sort_by, *filter(None, [self.split_by])} - {*self._by_name}:
            what = f"name {', '.join(sorted(unknown))}, not a column"
            raise ValueError(f"`key`, `sort_by` or `split_by` {what}")

    @property
    def source(self) -> str:
        return self.name.partition("/")[0]

    @property
    def short(self) -> str:
        return self.name.partition("/")[2]

    @property
    def stems(self) -> tuple[str, ...]:
        """What the names of its files in a release begin with."""
        return self.column(self.split_by).values if self.split_by else (self.short,)

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
    tables_by_name = {}
    paths = (path for root in SCHEMA_FOLDERS for path in (root / "tables").glob("*/*.toml"))
    for path in sorted(paths, key=lambda path: (path.parent.name, path.stem)):
        declared = load_table(path)
        expected = f"{path.parent.name}/{path.stem}"
        if declared.name != expected:
            raise SchemaMismatch(f"{path}: `name` is {declared.name!r}, its path says {expected!r}")
        tables_by_name[declared.name] = declared
    return tables_by_name


def table(name: str) -> Table:
    """The table "<source>/<table>". Raises UsageError that names the known ones."""
    try:
        return tables()[name]
    except KeyError:
        raise UsageError(
            f"no table {name!r} in schemas/", hint=f"known: {', '.join(tables())}"
        ) from None


def tables_of(source: str) -> list[Table]:
    """The declared tables of a source, or of what is made of sources, by name."""
    return [declared for declared in tables().values() if declared.source == source]


def released_tables(source: str) -> list[Table]:
    """Those of them that go into release/."""
    return [declared for declared in tables_of(source) if declared.released]


def load_table(path: Path) -> Table:
    """Reads one TOML file. Raises SchemaMismatch that names the block and what is wrong with it."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SchemaMismatch(f"{path}: not readable as TOML: {error}") from None
    for what in ("column", "input"):
        data[what] = [filled for block in data.get(what, ()) for filled in _blocks(block)]
    try:
        return msgspec.convert(data, Table, dec_hook=_origin)
    except msgspec.ValidationError as error:
        named = re.sub(
            r"\$\.(column|input)\[(\d+)\]",  # a block by its name instead of its number
            lambda at: f"{at[1]} {data[at[1]][int(at[2])].get('name', at[2])}",
            str(error),
        )
        raise SchemaMismatch(f"{path}: {named}") from None


def _blocks(block: dict[str, Any]) -> list[dict[str, Any]]:
    """The block, or one for each word of its `each`."""
    made = {key: value for key, value in block.items() if key != "each"}
    for word, names in _NAMES.items():
        if made.get("values") == [word]:
            made["values"] = list(names)
    if "words" in made:
        made["words"] = list(made["words"].items())
    return [_filled(made, word) for word in block["each"]] if "each" in block else [made]


def _filled(value: Any, word: str) -> Any:
    if isinstance(value, dict):
        return {key: _filled(inner, word) for key, inner in value.items()}
    if isinstance(value, list):
        return [_filled(inner, word) for inner in value]
    return value.replace("{}", word) if isinstance(value, str) else value


def conform(declared: Table | str, rows: pa.Table, *, released: bool = False) -> pa.Table:
    """`rows` with the declared columns, order and types, and the declaration's metadata.

    Casts only where no value changes. Raises SchemaMismatch that lists every undeclared column,
    every missing one, every value that does not fit and every null where none is allowed.
    """
    declared = table(declared) if isinstance(declared, str) else declared
    schema = declared.arrow(released)
    known, given = set(schema.names), set(rows.column_names)
    problems = [
        f"column {name!r} is not declared" for name in rows.column_names if name not in known
    ]
    problems += [f"column {name!r} is missing" for name in schema.names if name not in given]
    if len(given) < rows.num_columns:
        problems.append("a column is there twice")
    columns = []
    for field in schema:
        if field.name not in given or problems:
            continue
        column = rows.column(field.name)
        if column.type != field.type:
            try:
                column = column.cast(field.type)
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
                first = str(error).splitlines()[0]
                problems.append(
                    f"column {field.name!r} is {column.type}, not {field.type}: {first}"
                )
                continue
        if not field.nullable and column.null_count:
            problems.append(
                f"column {field.name!r} has {column.null_count} nulls and may have none"
            )
        columns.append(column)
    if problems:
        raise SchemaMismatch(
            f"{declared.name}: " + "; ".join(problems),
            hint=f"see schemas/tables/{declared.name}.toml",
        )
    return pa.Table.from_arrays(columns, schema=schema)


@dataclass(frozen=True)
class Type:
    """One parsed type: `text` as declared; `item` of a list; `fields` of a struct."""

    text: str
    item: Type | None = None
    fields: tuple[tuple[str, Type], ...] = ()

    def arrow(self) -> pa.DataType:
        if self.item is not None:
            return pa.list_(self.item.arrow())
        if self.fields:
            return pa.struct([(name, kind.arrow()) for name, kind in self.fields])
        if self.text.startswith("timestamp"):
            return pa.timestamp("us", tz="UTC")
        return getattr(pa, _PLAIN[self.text][0])()

    def croissant(self) -> str:
        """Croissant's data type; of a list that of its items, of a struct text."""
        if self.item is not None:
            return self.item.croissant()
        return _PLAIN[self.text][1] if not self.fields else "sc:Text"

    def hugging_face(self) -> dict[str, Any]:
        """The type as a feature in the front matter of a dataset card."""
        if self.fields:
            return {"struct": [{"name": name, **kind.hugging_face()} for name, kind in self.fields]}
        if self.item is not None:
            item = self.item.hugging_face()
            return {"list": item.get("dtype") or item.get("struct") or item}
        other = {"timestamp[us, UTC]": "timestamp[us, tz=UTC]", "date": "date32"}
        return {"dtype": other.get(self.text, self.text)}


def parse_type(text: str) -> Type:
    """Parses a declared type. Raises ValueError that says what is allowed."""
    text = text.strip()
    if text in _PLAIN:
        return Type(text)
    if match := re.fullmatch(r"list<(.+)>", text, re.DOTALL):
        return Type(text, item=parse_type(match[1]))
    if match := re.fullmatch(r"struct<(.+)>", text, re.DOTALL):
        fields = []
        for part in _split(match[1]):
            name, colon, kind = part.partition(":")
            if not colon or not re.fullmatch(r"[a-z][a-z0-9_]*", name.strip()):
                raise ValueError(f"{part.strip()!r} in {text!r} is not `name: type`")
            fields.append((name.strip(), parse_type(kind)))
        return Type(text, fields=tuple(fields))
    allowed = ", ".join(_PLAIN)
    raise ValueError(f"unknown type {text!r}; allowed: {allowed}, list<…>, struct<name: …>")


def _split(text: str) -> list[str]:
    """Splits at the commas that stand outside of brackets."""
    parts, depth, start = [], 0, 0
    for index, sign in enumerate(text):
        depth += sign in "<["
        depth -= sign in ">]"
        if sign == "," and depth == 0:
            parts.append(text[start:index])
            start = index + 1
    return [*parts, text[start:]]
