"""The type names that the TOML tables may use, and what each becomes elsewhere.

Grammar: `string | bool | int32 | int64 | float32 | float64 | date | timestamp[us, UTC]`,
`list<TYPE>` and `struct<NAME: TYPE, …>`, nested at will.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import pyarrow as pa

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
