"""Rows of clean tables as texts, in batches, as the matcher takes them.

A text is one part of one thing: a title, a description, a transcript, a page's visible text. What
belongs together without following on one another (a page's blocks, a post's text and the answers
of its poll) is one text that no phrase crosses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.installation import np
from kb.core.sources import made_of
from kb.pairs import transcripts
from kb.pairs.transcript_batch import Text
from kb.schema import table
from kb.schema.wiki_page import is_outermost
from kb.store.tables import parquet
from kb.store.tables.reading import reading

_EVIDENCE = "topic_evidence"  # a column of videos
_ROWS = 8192  # rows that are read at once
_BYTES = 8 << 20  # of texts that are looked through at once


class TextPart(NamedTuple):
    """Texts of one part; their `ids` are keys as links/links has them. `timed`: of a video."""

    part: str
    text: Text
    timed: bool = False


class TextSource(Protocol):
    """A source whose texts are linked."""

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        """The texts in a file of one of its tables, in batches. Raises DamagedData."""


def parts(source: TextSource, path: Path, table: str) -> Iterator[TextPart]:
    """The parts in a file of a clean table ("elements"), a batch at a time.

    Raises DamagedData.
    """
    with reading([path]):
        yield from source.texts(table, path)


def in_transcripts(path: Path) -> Iterator[TextPart]:
    """Transcripts of videos, with the times of their cues."""
    for text in transcripts.texts(path):
        yield TextPart("transcript", text, timed=True)


def in_columns(
    path: Path, key: str, parts: Mapping[str, tuple[str, ...]], prefix: str = ""
) -> Iterator[TextPart]:
    """Parts that are columns, by name; a release lacks some of them. `prefix` precedes the key."""
    names = [key, _EVIDENCE, *(name for columns in parts.values() for name in columns)]
    for rows in _batches(path, names):
        known = transcripts.topic_known(rows) if _EVIDENCE in rows.column_names else None
        keys = pc.binary_join_element_wise(prefix, rows[key].cast(pa.string()), "")
        for part, columns in parts.items():
            present = tuple(rows[name] for name in columns if name in rows.column_names)
            if present:
                yield from _texts(part, keys, present, known)


def in_elements(path: Path) -> Iterator[TextPart]:
    """The text of pages, shown or folded; a file holds whole pages, some hundred of them."""
    names = ["page_id", "element_id", "parent_id", "kind", "text", "reading_order"]
    rows = parquet.read_table(path, columns=[*names, "visible", "folded"])
    rows = rows.sort_by([("page_id", "ascending"), ("reading_order", "ascending")])
    pages, page = np.unique(rows["page_id"].to_numpy(), return_inverse=True)
    taken = np.asarray(_outermost(rows), np.int64)
    texts = _one(rows["text"]).take(pa.array(taken))
    keys = pa.array(pages).cast(pa.string())
    yield from in_pieces("page", keys, page[taken], texts)


def _outermost(rows: pa.Table) -> list[int]:
    """The rows whose texts are the visible text of their page with every word once."""
    pages, elements, above = (
        rows[name].to_pylist() for name in ("page_id", "element_id", "parent_id")
    )
    keys = list(zip(pages, elements, strict=True))
    parents = {key: (key[0], parent) for key, parent in zip(keys, above, strict=True)}
    kinds = dict(zip(keys, rows["kind"].to_pylist(), strict=True))
    read = pc.or_(rows["visible"], rows["folded"])
    shown = pc.and_(read, pc.is_valid(rows["text"])).to_pylist()
    return [
        row
        for row, key in enumerate(keys)
        if shown[row] and kinds[key] in ("text", "cell") and is_outermost(key, parents, kinds)
    ]


def _batches(path: Path, columns: list[str]) -> Iterator[pa.Table]:
    with parquet.open_file(path, pre_buffer=False, buffer_size=1 << 20) as file:
        there = [name for name in columns if name in file.schema_arrow.names]
        for batch in file.iter_batches(batch_size=_ROWS, columns=there, use_threads=False):
            yield pa.Table.from_batches([batch]).combine_chunks()


def _texts(
    part: str,
    keys: pa.ChunkedArray[Any],
    columns: tuple[pa.ChunkedArray[Any], ...],
    known: np.ndarray | None,
) -> Iterator[TextPart]:
    """One text a key, out of columns of texts and of lists of texts."""
    texts, things = [], []
    for column in columns:
        values = _one(column)
        thing = np.arange(len(values))
        if pa.types.is_list(values.type):
            thing = np.asarray(pc.list_parent_indices(values)).astype(np.int64)
            values = pc.list_flatten(values)
        texts.append(values.cast(pa.string()))
        things.append(thing)
    thing = np.concatenate(things)
    order = np.argsort(thing, kind="stable")
    taken = pa.concat_arrays(texts).take(pa.array(order))
    yield from in_pieces(part, _one(keys), thing[order], taken, known)


def _one(column: pa.ChunkedArray[Any]) -> pa.Array[Any]:
    return pa.concat_arrays([pa.array([], column.type), *column.chunks])


def in_pieces(
    part: str,
    keys: pa.Array[Any],
    thing: np.ndarray,
    texts: pa.Array[Any],
    known: np.ndarray | None = None,
) -> Iterator[TextPart]:
    """Texts of `keys`, each out of the `texts` whose `thing` is its number, in rising order; as
    many at once as make some megabytes. `known`: of which keys the topic is known.
    """
    texts = pc.fill_null(texts, "")
    ends = np.cumsum(np.asarray(pc.binary_length(texts)).astype(np.int64))
    begin = 0
    while begin < len(texts):
        before = ends[begin - 1] if begin else 0
        after = max(int(np.searchsorted(ends, before + _BYTES, "right")), begin + 1)
        if after < len(thing):  # whole things only, and one at least
            low = int(np.searchsorted(thing, thing[after]))
            after = low if low > begin else int(np.searchsorted(thing, thing[after], "right"))
        numbers = np.unique(thing[begin:after])
        counts = np.bincount(np.searchsorted(numbers, thing[begin:after]), minlength=len(numbers))
        mine = known[numbers] if known is not None else None
        some = texts.slice(begin, after - begin)
        yield TextPart(part, _joined(keys.take(pa.array(numbers)), counts, some, mine))
        begin = after


def _joined(
    keys: pa.Array[Any], counts: np.ndarray, texts: pa.Array[Any], known: np.ndarray | None
) -> Text:
    """Texts as transcripts without times."""
    kind = table(f"{made_of('pairs')[0]}/transcripts").arrow().field("cues").type
    nought = pa.array(np.zeros(len(texts)))
    cells = pa.StructArray.from_arrays(
        [nought, nought, texts], names=["start_s", "duration_s", "text"]
    )
    offsets = pa.array(np.concatenate(([0], np.cumsum(counts))), pa.int32())
    rows = {
        "video_id": keys,
        "kind": pa.array(["manual"] * len(keys), pa.string()),
        "cues": pa.ListArray.from_arrays(offsets, cells).cast(kind),
    }
    return Text(pa.table(rows), known=known, parted=True)
