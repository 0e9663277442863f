"""`data.search(words)`: ranked answers out of the index of a data root."""

from __future__ import annotations

import msgspec
import pyarrow as pa

from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.reader.opened import Opened
from kb.reader.rows import Answer
from kb.search.ask import SearchHit, search
from kb.search.passage import KINDS
from kb.search.rank import Only

_NUMBERS = ("score", "start_s")
_SCHEMA = pa.schema(
    [
        pa.field(name, pa.float64() if name in _NUMBERS else pa.string())
        for name in SearchHit.__struct_fields__
    ]
)


def find(
    opened: Opened,
    words: str,
    sources: tuple[str, ...],
    only: Only,
    size: int = 1000,
    entity: str = "",
) -> Answer:
    """The answers as rows, the best first. Raises UsageError without an index that is current."""
    for what, given, known in (("source", sources, SOURCES), ("kind", only.kinds, KINDS)):
        if wrong := [one for one in given if one not in known]:
            raise UsageError(f"no {what} {wrong[0]!r}", hint=f"one of {', '.join(known)}")
    roots = {one.home for name, one in opened.placed.items() if name.startswith("clean.")}
    if not roots:
        raise UsageError(
            f"no search index to look for {words!r} in: a release holds no texts",
            hint='load a data root; "kb index" makes its index',
        )
    hits = [
        one
        for root in sorted(roots)
        for one in search(root, words, sources=sources, only=only, size=size, entity=entity)
    ]
    hits.sort(key=lambda one: -one.score)
    rows = [msgspec.to_builtins(one) for one in hits[: only.limit]]
    return Answer(pa.Table.from_pylist(rows, schema=_SCHEMA))
