"""Reads the extraction of a captured page: what the page script measured.

Extractions are decoded to types with the fields that `schemas/tables/wiki/` names in `from` and
those that its rules read. One of another form is read field by field, to the same records.
"""

from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.schema.tables import Column, table
from kb.store.rawlog import sidefiles

SIDES = ("x", "y", "width", "height")
_Box = tuple[float, float, float, float]
_FILE = "extraction.json.zst"
_BY_RULES = ("alt", "caption", "crop", "frames", "lines", "src")  # an element may be without


class _PageAlone(msgspec.Struct, gc=False):
    page: dict[str, Any] = {}


class Extraction(msgspec.Struct, gc=False):
    """Sizes of the page, its elements in the order of the document, and what is told of them.

    Pages that were captured before these were read have neither facts nor recipes, nor lines.
    """

    page: dict[str, Any]
    elements: list[Any]
    cells: list[Any]
    sprites: dict[str, Any] = {}
    facts: list[Any] = []
    recipes: list[Any] = []


def read(root: Path, folder: Path) -> Extraction:
    """The extraction in a page's folder. Raises DamagedData, and notes the page for the next
    crawl.
    """
    text = _content(root, folder)
    try:
        extraction: Extraction = _decoder().decode(text)
    except msgspec.DecodeError:
        return _careful(_decoded(root, folder, text))
    return extraction


def is_foreign(page: dict[str, Any], page_id: int) -> bool:
    """Whether a capture is of another page than it was stored for.

    Earlier versions stored challenge pages like this. `page` is what the extraction says of the
    page; captures that do not hold what the page said of itself are taken for what they should be.
    """
    return bool(page.get("page_id", page_id) != page_id)


def page_of(folder: Path) -> dict[str, Any]:
    """What the extraction in a folder says of the page; empty where it can't be read."""
    try:
        text = _unpacked(folder)
        page: dict[str, Any] = msgspec.json.decode(text, type=_PageAlone).page
    except (OSError, zstandard.ZstdError, msgspec.DecodeError):
        return {}
    return page


def sprites(root: Path, folder: Path) -> dict[str, Any]:
    """The hashes of a page's icons by element; raises as `read`."""
    hashes: dict[str, Any] = _decoded(root, folder, _content(root, folder)).get("sprites", {})
    return hashes


@cache
def element() -> Any:
    """The type of an element."""
    declared = [column for column in table("wiki/elements").columns if column.name != "lines"]
    return _entry("Element", "elements", declared, _BY_RULES)


@cache
def cell() -> Any:
    """The type of a table's cell."""
    return _entry("Cell", "cells", table("wiki/cells").columns, (), row=int, column=int)


def field(column: Column) -> str:
    """The name of what a column is read from, "" where it is from no extraction."""
    entry, _, name = column.source.path.partition("[].")
    return (name or entry) if column.source.kind == "extraction" else ""


def _entry(name: str, entries: str, declared: Any, optional: tuple[str, ...], **more: Any) -> Any:
    fields: dict[str, Any] = {
        field(column): _type(column)
        for column in declared
        if column.source.path.startswith(f"{entries}[].")
    }
    none: list[Any] = [(each, Any, None) for each in optional]
    return msgspec.defstruct(name, [*(fields | more).items(), *none], gc=False)


def _type(column: Column) -> Any:
    if field(column) == "box":
        return _Box
    made = {"string": str, "bool": bool, "int64": int, "float64": float}[column.type]
    return made | None if column.nullable else made


@cache
def _decoder() -> msgspec.json.Decoder[Any]:
    entries = {"elements": list[element()], "cells": list[cell()]}  # type: ignore[misc]
    fields = [
        (each.name, entries.get(each.name, each.type), msgspec.field(**_default(each)))
        for each in msgspec.structs.fields(Extraction)
    ]
    return msgspec.json.Decoder(msgspec.defstruct("Typed", fields, gc=False))


def _default(each: msgspec.structs.FieldInfo) -> dict[str, Any]:
    return {} if each.required else {"default_factory": each.default_factory}


def _content(root: Path, folder: Path) -> bytes:
    try:
        return _unpacked(folder)
    except (OSError, zstandard.ZstdError) as error:
        raise _lost(root, folder / _FILE, error) from None


def _unpacked(folder: Path) -> bytes:
    return zstandard.ZstdDecompressor().decompressobj().decompress((folder / _FILE).read_bytes())


def _decoded(root: Path, folder: Path, text: bytes) -> dict[str, Any]:
    try:
        content: dict[str, Any] = msgspec.json.decode(text)
    except msgspec.DecodeError as error:
        raise _lost(root, folder / _FILE, error) from None
    return content


def _lost(root: Path, path: Path, error: Exception) -> Exception:
    damage = sidefiles.lost(root, "wiki", [path])
    damage.args = (f"{path} can't be read: {error}",)
    return damage


def _careful(content: dict[str, Any]) -> Extraction:
    more = {name: content[name] for name in ("sprites", "facts", "recipes") if name in content}
    elements = [_record(element(), entry) for entry in content["elements"]]
    cells = [_record(cell(), entry) for entry in content["cells"]]
    return Extraction(content["page"], elements, cells, **more)


def _record(kind: Any, entry: dict[str, Any]) -> Any:
    """An entry as a record, whatever its fields hold. Raises KeyError for one that lacks one."""
    return kind(
        **{
            each.name: entry[each.name] if each.required else entry.get(each.name)
            for each in msgspec.structs.fields(kind)
        }
    )
