"""What is linked to an entity: the keys that `kb links` found, by source."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import indexed, linked
from kb.artifacts.catalog import Catalog
from kb.core.errors import UsageError
from kb.store import parquet
from kb.store.reading import reading


def restrict(root: Path, name: str, sources: Sequence[str]) -> dict[str, list[str]]:
    """The keys that are linked to an entity, for `kb.search.rank.rank`.

    Raises UsageError where there are no entity tables, they are older than the clean tables that
    are searched, or no entity has that name; DamagedData.
    """
    now = {source: note.files for source in sources if (note := indexed.read(root, source))}
    linked.check(root, now)
    return keys(root, entity(root, name), sources)


def entity(root: Path, name: str) -> str:
    """The entity of that name, or whose other form it is. Raises UsageError with the nearest."""
    wanted = " ".join(name.split()).casefold()
    rows: list[dict[str, Any]] = []
    files = Catalog(root.absolute()).files("links/entities")
    with reading(files):
        for path in files:
            rows += parquet.read_table(path, columns=["entity", "aliases"]).to_pylist()
    names = {str(row["entity"]).casefold(): str(row["entity"]) for row in rows}
    forms = {alias: str(row["entity"]) for row in rows for alias in row["aliases"]}
    if found := names.get(wanted) or forms.get(wanted):
        return found
    near = difflib.get_close_matches(wanted, [*names, *forms], n=3, cutoff=0.6)
    listed = dict.fromkeys(names.get(one) or forms[one] for one in near)
    hint = f"did you mean {' or '.join(listed)}?" if listed else ""
    lists = '`kb query "SELECT entity FROM links.entities"` lists them'
    raise UsageError(f"no entity {name!r}", hint=hint or lists)


def keys(root: Path, name: str, sources: Sequence[str]) -> dict[str, list[str]]:
    """The keys that are linked to an entity, sorted. Only row groups that may name it are read."""
    held: dict[str, set[str]] = {source: set() for source in sources}
    files = Catalog(root.absolute()).files("links/links")
    with reading(files):
        for path in files:
            with parquet.open_file(path) as file:
                for group in range(file.metadata.num_row_groups):
                    about: Any = file.metadata.row_group(group).column(0).statistics
                    known = about is not None and about.has_min_max
                    if known and not about.min <= name <= about.max:
                        continue
                    rows = file.read_row_group(group, columns=["entity", "source", "key"])
                    mine = rows.filter(pc.equal(rows["entity"].cast(pa.string()), name))
                    pairs = zip(mine["source"].to_pylist(), mine["key"].to_pylist(), strict=True)
                    for source, key in cast("list[tuple[str, str]]", list(pairs)):
                        if source in held:
                            held[source].add(key)
    return {source: sorted(found) for source, found in held.items()}
