"""Rows of pairs, one video after the other."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import pyarrow as pa

from kb.clips.clip_files import Row
from kb.store.tables import database
from kb.store.tables.reading import reading, scan


@contextlib.contextmanager
def pairs_of(
    root: Path, files: Collection[Path], videos: Collection[str], columns: str
) -> Iterator[pa.RecordBatchReader]:
    """These columns of the pairs of these videos, by video and id. `files`: those of pairs/pairs.
    Raises DamagedData.
    """
    with reading(files), database.connect(root) as con:
        con.register("wanted", pa.table({"video_id": pa.array(sorted(videos), pa.string())}))
        yield con.sql(f"""
            SELECT {columns} FROM {scan(files)} SEMI JOIN wanted USING (video_id)
            ORDER BY video_id, pair_id""").to_arrow_reader()


def by_video(batches: Iterable[pa.RecordBatch]) -> Iterator[list[Row]]:
    """The rows of each video, of batches in which those of a video follow each other."""
    rows = (row for batch in batches for row in batch.to_pylist())
    return (list(own) for _, own in groupby(rows, key=itemgetter("video_id")))
