"""What a thing is made of, down to what is gathered: the tree of `wiki_recipe_edges`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from kb.core.errors import UsageError
from kb.core.suggestions import did_you_mean, similar
from kb.reader.tables import OpenTables

_MOST_NODES = 10_000
_EDGES = """
    SELECT recipe_id, page_id, station, product, product_slot, product_page_id, product_quantity,
        ingredient, ingredient_page_id, ingredient_quantity
    FROM {} ORDER BY page_id, length(recipe_id), recipe_id, slot, product_slot"""


@dataclass
class _Recipe:
    """A recipe of one product: `quantity` pieces of it, in the slot `slot`; what it `needs`."""

    id: str
    page_id: int
    station: str
    quantity: int
    slot: int
    needs: list[tuple[str, int]] = field(default_factory=list)


class RecipeGraph:
    """The recipes of open tables. Raises UsageError where they have none."""

    def __init__(self, opened: OpenTables) -> None:
        views = opened.ranked("wiki_recipe_edges")
        if not views:
            raise UsageError(
                "the data have no table wiki_recipe_edges", hint="data.tables lists the tables"
            )
        self._names: dict[str, str] = {}  # of things, by their name in small letters
        self._pages: dict[str, int | None] = {}
        recipes: dict[str, dict[str, _Recipe]] = defaultdict(dict)
        main: dict[str, int] = {}
        for edge in opened.rows(_EDGES.format(views[0].full), []).to_pylist():
            made, needed = edge["product"], edge["ingredient"]
            self._note(needed, edge["ingredient_page_id"])
            if made is None:
                continue
            self._note(made, edge["product_page_id"])
            slot = edge["product_slot"]
            main[edge["recipe_id"]] = min(main.get(edge["recipe_id"], slot), slot)
            recipe = recipes[made.casefold()].setdefault(
                edge["recipe_id"],
                _Recipe(
                    edge["recipe_id"],
                    edge["page_id"],
                    edge["station"],
                    edge["product_quantity"] or 1,
                    slot,
                ),
            )
            recipe.needs.append((needed, edge["ingredient_quantity"] or 1))
        self._recipes = {name: [*some.values()] for name, some in recipes.items()}
        self._main = main

    def tree(self, name: str, quantity: int) -> dict[str, Any]:
        """The tree of a thing, as nested dictionaries. Raises UsageError with the nearest names."""
        if quantity < 1:
            raise UsageError(f"quantity is {quantity}", hint="ask for one thing or more")
        known = self._names.get(name.casefold())
        if known is None:
            near = did_you_mean(similar(name, self._names.values()))
            raise UsageError(
                f"no recipe has {name!r}.{near}", hint="wiki_recipe_edges lists what recipes have"
            )
        self._count = 0
        return self._node(known, quantity, {})

    def _note(self, name: str, page: int | None) -> None:
        self._names.setdefault(name.casefold(), name)
        self._pages[name.casefold()] = self._pages.get(name.casefold()) or page

    def _node(self, name: str, quantity: int, above: Mapping[str, None]) -> dict[str, Any]:
        self._count += 1
        if self._count > _MOST_NODES:
            raise UsageError(
                f"the tree has more than {_MOST_NODES:,} branches",
                hint="query wiki_recipe_edges for one step at a time",
            )
        key = name.casefold()
        node: dict[str, Any] = {
            "item": name,
            "page_id": self._pages.get(key),
            "quantity": quantity,
            "station": None,
            "recipe_id": None,
            "needs": [],
        }
        if key in above:
            return {**node, "cycle": True}
        if (recipe := self._recipe(key)) is not None:
            times = -(-quantity // recipe.quantity)
            node |= {"station": recipe.station, "recipe_id": recipe.id}
            below = {**above, key: None}
            node["needs"] = [
                self._node(self._names[needed.casefold()], amount * times, below)
                for needed, amount in recipe.needs
            ]
        return node

    def _recipe(self, key: str) -> _Recipe | None:
        """The recipe to follow: one that is for the thing, that does not take apart what is made of
        it, and that its own page shows; else the first.
        """

        def rank(recipe: _Recipe) -> tuple[bool, bool, bool]:
            return (
                recipe.slot > self._main[recipe.id],
                any(self._is_made_of(needed.casefold(), key) for needed, _ in recipe.needs),
                recipe.page_id != self._pages.get(key),
            )

        return min(self._recipes.get(key, ()), key=rank, default=None)

    def _is_made_of(self, name: str, thing: str) -> bool:
        return any(
            needed.casefold() == thing
            for recipe in self._recipes.get(name, ())
            for needed, _ in recipe.needs
        )
