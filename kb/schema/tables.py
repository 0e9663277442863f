"""Tables as declared in `schemas/tables/<source>/<table>.toml`: in types, and in Arrow's."""

import tomllib
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.errors import SchemaMismatch, UsageError
from kb.core.installation import folder
from kb.schema.declaration import blocks, check_table
from kb.schema.types import Type, parse_type


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
    also: tuple[Origin, ...] = ()
    parsed: Type = field(repr=False, compare=False, default=None)  # type: ignore[assignment]

    @property
    def nullable(self) -> bool:
        return bool(self.why_null)

    def origin(self, kind: str) -> Origin | None:
        """Where an answer of the raw kind has the value; None where it has none."""
        return next((one for one in (self.source, *self.also) if one.kind == kind), None)


@dataclass(frozen=True)
class Table:
    """A declared table. `name` is "<source>/<table>"."""

    name: str
    doc: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]
    sort_by: tuple[str, ...]
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
    problems = check_table(data)
    if problems:
        raise SchemaMismatch(f"{path}: " + "; ".join(problems))
    columns = tuple(_column(block) for block in blocks(data, "column"))
    inputs = tuple(_column(block) for block in blocks(data, "input"))
    plain = {key: data[key] for key in ("name", "doc", "released") if key in data}
    return Table(
        columns=columns,
        inputs=inputs,
        key=tuple(data["key"]),
        sort_by=tuple(data["sort_by"]),
        **plain,
    )


def _column(block: dict[str, Any]) -> Column:
    return Column(
        name=block["name"],
        type=block["type"],
        unit=block.get("unit", ""),
        doc=block["doc"],
        source=_origin(block["from"]),
        why_null=block.get("null", ""),
        released=block.get("released", False),
        content=block.get("content", False),
        dictionary=block.get("dictionary", False),
        values=tuple(block.get("values", ())),
        pattern=block.get("pattern", ""),
        also=tuple(map(_origin, block.get("also", ()))),
        parsed=parse_type(block["type"]),
    )


def _origin(text: str) -> Origin:
    kind, _, path = text.partition(":")
    return Origin(kind.strip(), path.strip())
