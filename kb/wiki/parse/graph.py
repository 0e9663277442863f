"""Makes wiki/page_links, categories, redirects and recipe_edges: pages and things, and what leads
from one to the other.

A page's rows are made of its extraction and of what the wiki says of it. Which page a title means
is known when all pages were judged (`resolve_titles`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.schema.wiki_page import ancestors, is_outermost
from kb.store.layout import parquet_files
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table

Row = dict[str, Any]
Stations = Mapping[str, Sequence[str]]

OTHER = "other"  # the station of a recipe that names none
_TITLES = {  # columns of titles → those of the pages that they mean
    "page_links": {"target_title": "target_page_id"},
    "recipe_edges": {"product": "product_page_id", "ingredient": "ingredient_page_id"},
}


def page_links(page_id: int, elements: Sequence[Row]) -> Iterator[Row]:
    """Rows of wiki/page_links of a page without the targets' ids; `elements` as extracted."""
    parents = {element["id"]: element["parent"] for element in elements}
    kinds = {element["id"]: element["kind"] for element in elements}
    counts: Counter[tuple[str, str, str, str]] = Counter()
    for element, path in zip(elements, _paths(elements), strict=True):
        shown = element["visible"] or element.get("folded")
        if not (shown and element.get("marks") and is_outermost(element["id"], parents, kinds)):
            continue
        section = path[0] if path else ""
        for start, end, title, *_ in element["marks"]:
            if words := " ".join(element["text"][start:end].split()):
                counts[title, section, element["region"], words] += 1
    for (title, section, region, words), count in sorted(counts.items()):
        yield {
            "page_id": page_id,
            "target_title": title,
            "section": section,
            "region": region,
            "text": words,
            "count": count,
        }


def names(page: Row, removed: Collection[str]) -> dict[str, list[Row]]:
    """Rows of wiki/categories and wiki/redirects of a page; none of titles `removed`."""
    key, titles = page["page_id"], {*(page["redirects"] or ())} - {*removed}
    categories = {name.partition(":")[2] or name for name in page["categories"] or ()}
    return {
        "categories": [{"page_id": key, "category": name} for name in sorted(categories)],
        "redirects": [{"title": title, "page_id": key} for title in sorted(titles)],
    }


class _Slot(NamedTuple):
    """What the slots with the same content hold: the number of the first, things in turn, and how
    many of each.
    """

    number: int
    things: tuple[str, ...]
    quantities: tuple[int | None, ...]


def recipe_edges(
    slots: Iterable[Row], elements: Sequence[Row], shapes: Sequence[Sequence[str]], kinds: Stations
) -> Iterator[Row]:
    """Rows of wiki/recipe_edges of a page, without the ids of things.

    `slots` are its rows of wiki/recipes, `shapes` what its recipes call themselves, in their order,
    and `kinds` the words of each station. Recipes without an ingredient have no rows.
    """
    sections = dict(zip((element["id"] for element in elements), _paths(elements), strict=True))
    parents = {element["id"]: element["parent"] for element in elements}
    captions = {
        element["parent"]: element["text"] for element in elements if element["tag"] == "caption"
    }
    for number, group in groupby(slots, lambda slot: slot["recipe_index"]):
        own = list(group)
        at = next((slot["element_id"] for slot in own if slot["element_id"] is not None), None)
        around = [captions[key] for key in ancestors(at, parents) if key in captions]
        evidence = [*(shapes[number] if number < len(shapes) else ()), *around]
        station = _station([*evidence, *sections.get(at, ())], kinds)
        for name, ingredients, products in _turns(f"{own[0]['page_id']}-{number}", own):
            for ingredient in ingredients:
                for product in products or (None,):
                    yield {
                        "recipe_id": name,
                        "page_id": own[0]["page_id"],
                        "slot": ingredient.number,
                        "station": station,
                        "product": product.things[0] if product else None,
                        "product_slot": product.number if product else None,
                        "product_quantity": product.quantities[0] if product else None,
                        "ingredient": ingredient.things[0],
                        "ingredient_quantity": ingredient.quantities[0],
                        "alternatives": list(ingredient.things[1:]),
                        "revision_id": own[0]["revision_id"],
                    }


def _paths(elements: Iterable[Row]) -> Iterator[tuple[str, ...]]:
    """For each element the headings that it stands under, the nearest first, itself included."""
    headings: list[tuple[int, str]] = []
    for element in elements:
        level = element.get("level")
        if level and level > 1 and element["region"] != "infobox":
            headings = [
                (level, " ".join((element["text"] or "").split())),
                *(heading for heading in headings if heading[0] < level),
            ]
        yield tuple(text for _, text in headings)


def _station(evidence: Iterable[str], kinds: Stations) -> str:
    """The station of the first text that holds a word of one."""
    for text in evidence:
        plain = re.sub(r"[\W_]+", " ", text).casefold()
        for station, words in kinds.items():
            if any(f" {word.casefold()} " in f" {plain} " for word in words):
                return station
    return OTHER


def _turns(name: str, slots: Sequence[Row]) -> Iterator[tuple[str, list[_Slot], list[_Slot]]]:
    """The recipes that one grid of slots shows: their ids, ingredients and products.

    Where an outcome is shown in turn with the ingredients of as many slots, each turn is a recipe.
    """
    cells = [list(group) for _, group in groupby(slots, lambda slot: slot["slot"])]
    outcomes = [cell for cell in cells if cell[0]["role"] == "output"]
    inputs = [cell for cell in cells if cell[0]["role"] != "output"]
    turning = max((len(cell) for cell in outcomes), default=1)
    if turning > 1 and any(len(cell) == turning for cell in inputs):
        for turn in range(turning):
            ingredients, products = (
                _added_up([cell[turn]] if len(cell) == turning else cell for cell in some)
                for some in (inputs, outcomes)
            )
            yield f"{name}-{turn}", ingredients, products
        return
    # An outcome by chance: each thing that may come out is a product.
    apart = ([thing] for cell in outcomes for thing in cell)
    yield name, _added_up(inputs), _added_up(apart)


def _added_up(cells: Iterable[Sequence[Row]]) -> list[_Slot]:
    """What lies in the slots; those that hold the same things count together."""
    slots: dict[tuple[str, ...], _Slot] = {}
    for cell in cells:
        amounts: dict[str, int | None] = {}
        for thing in cell:
            if thing["item"]:
                amounts.setdefault(thing["item"], thing["quantity"])
        if not amounts:
            continue
        things, quantities = tuple(amounts), tuple(amounts.values())
        if (known := slots.get(things)) is not None:
            quantities = tuple(
                None if quantity is None or other is None else quantity + other
                for quantity, other in zip(known.quantities, quantities, strict=True)
            )
        number = known.number if known is not None else cell[0]["slot"]
        slots[things] = _Slot(number, things, quantities)
    return list(slots.values())


def resolve_titles(clean: Path) -> dict[str, int]:
    """Give titles in the new clean tables the ids of the kept pages that they mean, and leave out
    redirects to a title that is a page's own, or that another page has by a newer answer.

    Returns the change in the number of rows by table.
    """
    pages = _rows(clean / "pages", ["page_id", "title", "fetched_at"])
    newest = {page["page_id"]: page["fetched_at"] for page in pages}
    ids: dict[str, int] = {page["title"]: page["page_id"] for page in pages}
    owners: dict[str, int] = {}
    for redirect in _rows(clean / "redirects", ["title", "page_id"]):
        title, page = redirect["title"], redirect["page_id"]
        other = owners.get(title, page)
        if title not in ids:
            owners[title] = max(page, other, key=lambda key: (newest[key], key))
    left_out = 0
    for path in parquet_files(clean / "redirects"):
        rows = parquet.read_table(path)
        owned = [owners.get(row["title"]) == row["page_id"] for row in rows.to_pylist()]
        left_out += owned.count(False)
        if False in owned:
            write_table(path, rows.filter(pa.array(owned)), "wiki/redirects", sync=False)
    # What lies in a slot may be named with a small letter first, which no title begins with.
    known = {**owners, **ids}
    titles = pa.array(known, pa.string())
    values = pa.array(known.values(), pa.int64())
    for short, columns in _TITLES.items():
        for path in parquet_files(clean / short):
            rows = parquet.read_table(path)
            for title, target in columns.items():
                places = pc.index_in(_capitalised(rows[title]), value_set=titles, skip_nulls=True)
                ids_of = values.take(places.combine_chunks())
                rows = rows.set_column(rows.column_names.index(target), target, ids_of)
            write_table(path, rows, f"wiki/{short}", sync=False)
    return {"wiki/redirects": -left_out}


def _capitalised(titles: pa.ChunkedArray[Any]) -> pa.ChunkedArray[Any]:
    first = pc.utf8_upper(pc.utf8_slice_codeunits(titles, 0, 1))
    return pc.binary_join_element_wise(first, pc.utf8_slice_codeunits(titles, 1), "")


def _rows(folder: Path, columns: list[str]) -> list[Row]:
    parts = (parquet.read_table(path, columns) for path in parquet_files(folder))
    return [row for part in parts for row in part.to_pylist()]
