"""What several packages need to know of a wiki page: its names, and which of its nested elements
(`wiki/elements`) to take so that each text counts once.

A list's text contains the texts of its items, a figure's that of its caption. Elements are given as
mappings from their id: to the id of the parent, and to the kind.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

_HOLDERS = ("text", "cell", "table")


class PageNames(NamedTuple):
    """What a wiki calls a page: title, redirects and categories, each without its namespace."""

    title: str
    redirects: Sequence[str] = ()
    categories: Sequence[str] = ()


def ancestors(element: Any, parents: Mapping[Any, Any]) -> Iterator[Any]:
    """The elements around one, nearest first; each once, even where parents form a cycle."""
    passed = {element}
    while (element := parents.get(element)) in parents and element not in passed:
        passed.add(element)
        yield element


def is_outermost(element: Any, parents: Mapping[Any, Any], kinds: Mapping[Any, Any]) -> bool:
    """Whether no other text contains this one's text: the nearest text, cell or table around it
    is a table, or there is none. A text never includes the table that it contains.
    """
    around = (kinds[ancestor] for ancestor in ancestors(element, parents))
    return next((kind for kind in around if kind in _HOLDERS), "table") == "table"
