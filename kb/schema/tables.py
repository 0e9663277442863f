"""Tables as declared in `schemas/tables/<source>/<table>.toml`: in types, and in Arrow's.

A file has the keys of `Table`, then one `[[column]]` block a column with the keys of `Column`. An
`[[input]]` block has the same keys and stands for a value that parsing reads and a later rule uses
up: it is in no table. A block with `each`, a list of words, stands for one column a word, put in
place of {}; `values = ["<source>"]` stands for the name of every source.
"""

import re
import tomllib
from collections import Counter
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import pyarrow as pa
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.installation import folder
from kb.core.sources import SOURCES
from kb.schema.types import Type, parse_type

Text = Annotated[str, Field(pattern=r"\S")]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class Origin(NamedTuple):
    """Where a value comes from: `kind` is a raw kind, "envelope", "annotation" or "rule"."""

    kind: str
    path: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}"


def _origin(text: str) -> Origin:
    kind, _, path = str(text).partition(":")
    if not (kind.strip() and path.strip()):
        raise ValueError(f"{text!r} must read `<raw kind>: <path>` or `rule: <how>`")
    return Origin(kind.strip(), path.strip())


Source = Annotated[Origin, BeforeValidator(_origin)]


class Column(BaseModel):
    """A column of a table.

    type        see kb.schema.types
    unit        what a number counts ("s", "px", "views"); absent for text and ids
    doc         one line
    from        "<raw kind>: <path>", "envelope: <field>", "annotation: <what>" or "rule: <how>"
    null        why the value may be absent; without it the column is never null
    released    true where the column goes into release/
    content     true for what people wrote (titles, texts, addresses, names)
    dictionary  true for low-cardinality columns that Parquet stores with a dictionary
    values      the words that a text column may hold; the release gate refuses others
    pattern     a regular expression that each whole text of the column has; checked there as well
    also        further raw kinds that have the value, each as in `from`
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    type: str
    unit: str = ""
    doc: Annotated[str, Field(pattern=r"^[^\n]*\S[^\n]*$")]
    source: Source = Field(alias="from")
    why_null: Text = Field("", alias="null")
    released: bool = False
    content: bool = False
    dictionary: bool = False
    values: tuple[str, ...] = Field((), min_length=1)
    pattern: str = ""
    also: tuple[Source, ...] = ()

    @field_validator("type")
    @classmethod
    def _is_type(cls, text: str) -> str:
        parse_type(text)
        return text

    @field_validator("pattern")
    @classmethod
    def _is_pattern(cls, text: str) -> str:
        try:
            re.compile(text)
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from None
        return text

    @model_validator(mode="after")
    def _is_text(self) -> Self:
        if (self.values or self.pattern) and self.type != "string":
            raise ValueError("`values` and `pattern` are for columns of type string")
        return self

    @cached_property
    def parsed(self) -> Type:
        """Its type."""
        return parse_type(self.type)

    @property
    def nullable(self) -> bool:
        return bool(self.why_null)

    def origin(self, kind: str) -> Origin | None:
        """Where an answer of the raw kind has the value; None where it has none."""
        return next((one for one in (self.source, *self.also) if one.kind == kind), None)


class Table(BaseModel):
    """A declared table. `name` is "<source>/<table>"; `key` and `sort_by` name columns."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Text
    doc: Text
    columns: tuple[Column, ...] = Field(min_length=1, alias="column")
    key: tuple[str, ...] = Field(min_length=1)
    sort_by: tuple[str, ...] = Field(min_length=1)
    released: bool = False
    inputs: tuple[Column, ...] = Field((), alias="input")

    @model_validator(mode="after")
    def _names_fit(self) -> Self:
        names = Counter(one.name for one in (*self.columns, *self.inputs))
        if twice := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"declared twice: {', '.join(twice)}")
        if unknown := {*self.key, *self.sort_by} - set(self._by_name):
            raise ValueError(f"`key` or `sort_by` name {', '.join(sorted(unknown))}, not a column")
        return self

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
    tables_by_name = {}
    for path in sorted(root.glob("*/*.toml")):
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


def released_tables(source: str) -> list[Table]:
    """The declared tables of a source that go into release/, in the order of their names."""
    return [one for one in tables().values() if one.source == source and one.released]


def load_table(path: Path) -> Table:
    """Reads one TOML file. Raises SchemaMismatch that lists every problem of the file at once."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SchemaMismatch(f"{path}: not readable as TOML: {error}") from None
    for what in ("column", "input"):
        data[what] = [one for block in data.get(what, ()) for one in _blocks(block)]
    try:
        return Table.model_validate(data)
    except ValidationError as error:
        problems = (_problem(one, data) for one in error.errors(include_url=False))
        raise SchemaMismatch(f"{path}: " + "; ".join(problems)) from None


def _blocks(block: dict[str, Any]) -> list[dict[str, Any]]:
    """The block, or one for each word of its `each`."""
    made = {key: value for key, value in block.items() if key != "each"}
    if made.get("values") == ["<source>"]:
        made["values"] = list(SOURCES)
    return [_filled(made, word) for word in block["each"]] if "each" in block else [made]


def _filled(value: Any, word: str) -> Any:
    if isinstance(value, dict):
        return {key: _filled(one, word) for key, one in value.items()}
    if isinstance(value, list):
        return [_filled(one, word) for one in value]
    return value.replace("{}", word) if isinstance(value, str) else value


def _problem(error: Any, data: dict[str, Any]) -> str:
    """A problem with the name of its block, as "column views: unit: Input should be …"."""
    place = list(error["loc"])
    if len(place) > 1 and isinstance(place[1], int):
        block = data[place[0]][place[1]]
        place[:2] = [f"{place[0]} {block.get('name', place[1] + 1)}"]
    return ": ".join(map(str, [*place, error["msg"].removeprefix("Value error, ")]))
