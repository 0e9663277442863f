"""Wiki pages as documents of the text export: wiki/page_text in its blocks."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from kb.export.text import TextDocument, TextFiles, TextPiece
from kb.schema.tables import table
from kb.store.tables.merge import Merge, RowsByKey
from kb.store.tables.shard_writer import order
from kb.wiki.markdown import GAP

_PAGE = (
    *("page_id", "title", "url", "license", "contributors_url", "revision_id"),
    *("revision_timestamp", "fetched_at"),
)
_AHEAD = 4_096  # rows that are read ahead
_HEADING = re.compile("(#{1,6}) ")
_FENCE = ("```", "~~~~")  # no line of a text begins with one


def documents(files: TextFiles) -> Iterator[TextDocument]:
    """The kept pages of one bucket, by id. Raises DamagedData."""
    texts = RowsByKey(_rows(files["wiki/page_text"], "page_text", ("page_id", "text")), "page_id")
    for page in _rows(files["wiki/pages"], "pages", _PAGE):
        (own,) = texts.rows_of(page["page_id"])
        yield TextDocument(
            str(page["page_id"]),
            page["title"],
            [_piece(block) for block in _blocks(own["text"])][1:],  # without its title
            page["fetched_at"],
            page["revision_timestamp"],
            {name: page[name] for name in ("url", "license", "contributors_url", "revision_id")},
        )


def _rows(paths: Sequence[str], short: str, columns: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    if paths:
        by = order(table(f"wiki/{short}"))
        with closing(Merge([*map(Path, paths)], by, list(columns), ahead=_AHEAD)) as merge:
            for rows in merge:
                yield from rows.to_pylist()


def _blocks(text: str) -> Iterator[str]:
    """The blocks of a text; what stands between two fences is one, with its empty lines."""
    block: list[str] = []
    fence = ""
    for part in text.split(GAP):
        block.append(part)
        if not fence:
            fence = next((mark for mark in _FENCE if part.startswith(mark)), "")
        if not fence or (part.endswith(f"\n{fence}")):
            yield GAP.join(block)
            block, fence = [], ""
    if block:
        yield GAP.join(block)


def _piece(block: str) -> TextPiece:
    heading = _HEADING.match(block)
    return TextPiece(block, begins=bool(heading), level=len(heading[1]) if heading else 0)
