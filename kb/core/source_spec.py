"""What a source declares of its release: light data that names code as
"module:attribute", imported when it is first needed.
"""

import importlib
from dataclasses import dataclass
from typing import Any


def load_name(name: str) -> Any:
    """The attribute that "module:attribute" names."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


@dataclass(frozen=True)
class ReleaseSpec:
    """What a release folder holds, of a source or of what is made from sources.

    main        the table that a reader means who names none
    query       the first query on the card
    counted     tables whose rows go through the filters; `main` alone by default
    stages      the stages of the filters, in order, which the card pictures
    pictured    the column whose frequent values it pictures instead
    rules       keys of the profile that decide which rows are released
    section     the section of these keys; the source's own by default
    gaps        functions that describe what the tables lack
    quality     the function that describes how good the rows are, with figures
    ids_only    text columns hold ids and short names only
    archives    kinds of tar archives beside the tables
    paths       (table, column) pairs that name a file in an archive
    licensed    tables whose rows name a licence of their own
    licence     SPDX id when the profile gives none
    scraped     whether some of it was read from web pages
    origin      address of the service, with keys of the profile's section in braces
    extra       the package extra that the card's commands need
    part_of     the source whose filter and export also make this folder, of licensed texts
    """

    main: str
    query: str
    counted: tuple[str, ...] = ()
    stages: tuple[str, ...] = ()
    pictured: str = ""
    rules: tuple[str, ...] = ()
    section: str = ""
    gaps: tuple[str, ...] = ()
    quality: str = ""
    ids_only: bool = False
    archives: tuple[str, ...] = ()
    paths: tuple[tuple[str, str], ...] = ()
    licensed: tuple[str, ...] = ()
    licence: str = "CC-BY-4.0"
    scraped: bool = False
    origin: str = ""
    extra: str = ""
    part_of: str = ""
