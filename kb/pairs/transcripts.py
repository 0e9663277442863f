"""Reads transcripts of clean/youtube, a few hundred at a time."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import manifest
from kb.core.errors import FatalError
from kb.core.installation import np
from kb.core.sources import made_of
from kb.pairs.transcript_batch import Text
from kb.schema.video_facts import TOPIC_KNOWN
from kb.store.layout import parquet_files
from kb.store.rawlog import rawlog
from kb.store.tables import parquet
from kb.store.tables.reading import reading

(VIDEOS,) = made_of("pairs")  # the source of the videos
_ROWS = 128  # transcripts in memory at once: some 2 MB of text, which the cache half holds
_COLUMNS = ["video_id", "kind", "cues"]
_OF_VIDEOS = ("video_id", "channel_id", "topic_evidence")
_CUES = 2_000_000  # cues in memory at once, whatever the number of transcripts


def parts(root: Path, table: str = "transcripts", *, index: Path | None = None) -> list[Path]:
    """The files of a clean YouTube table, in order. FatalError when there are no transcripts.

    `index`: the released pairs whose transcripts are wanted, for the advice.
    """
    files = manifest.rows(root, f"{VIDEOS}/{table}")
    if not files and table == "transcripts":
        hint = "run `kb youtube filter` first"
        if not rawlog.any_answer(root, VIDEOS):
            ids = f" --ids {shlex.quote(str(index))}" if index is not None else ""
            crawl = f"kb youtube crawl{ids}"
            hint = f"run `{crawl}`, then `kb youtube filter`, then this command again"
        raise FatalError("there are no transcripts in clean/youtube", hint=hint)
    return files


def rows(path: Path) -> int:
    """Transcripts in a file."""
    with reading([path]):
        return int(parquet.footer(path).num_rows)


def texts(path: Path, first: int = 0, after: int | None = None) -> Iterator[Text]:
    """Transcripts `first` up to `after` of a file, in batches, with lengths and channels of their
    videos.
    """
    of_file = _Videos(path)
    with reading([path]), parquet.open_file(path, pre_buffer=False, buffer_size=1 << 20) as file:
        after = file.metadata.num_rows if after is None else after
        at, groups = 0, []
        begin = 0
        for group in range(file.num_row_groups):
            size = file.metadata.row_group(group).num_rows
            if at + size > first and at < after:
                groups.append(group)
            elif at + size <= first:
                begin = at + size
            at += size
        place = begin
        for batch in (
            file.iter_batches(
                batch_size=_ROWS, row_groups=groups, columns=_COLUMNS, use_threads=False
            )
            if groups
            else ()
        ):
            low, high = max(first - place, 0), min(after - place, batch.num_rows)
            place += batch.num_rows
            if low < high:
                for piece in _pieces(pa.Table.from_batches([batch.slice(low, high - low)])):
                    of = of_file.of(piece.column("video_id"))
                    lengths, known = of["duration_s"].combine_chunks(), topic_known(of)
                    yield Text(piece, lengths, of["channel_id"], known=known)
            if place >= after:
                return


def topic_known(videos: pa.Table) -> np.ndarray:
    """Which rows of youtube/videos are known to be about the topic (bool). Keywords alone only make
    it likely.
    """
    evidence = videos["topic_evidence"].cast(pa.string())
    known = pc.is_in(evidence, value_set=pa.array(TOPIC_KNOWN, pa.string()))
    return np.asarray(known.to_numpy(), bool)


def of_videos(root: Path, ids: pa.Array[Any]) -> pa.Table:
    """The kept transcripts of these videos, in no order that matters. Raises DamagedData."""
    kept: list[pa.Table] = []
    for path in parts(root):
        with reading([path]), parquet.open_file(path) as file:
            for group in range(file.num_row_groups):
                rows = file.read_row_group(group, columns=["video_id"])
                wanted = pc.is_in(rows["video_id"].cast(pa.string()), value_set=ids)
                if pc.any(wanted).as_py():
                    kept.append(file.read_row_group(group, columns=_COLUMNS).filter(wanted))
    return pa.concat_tables(kept, promote_options="permissive")


def videos(files: list[Path]) -> pa.Table:
    """`video_id`, `channel_id`, `topic_evidence` and `duration_s` of the files of youtube/videos.
    Raises DamagedData.
    """
    texts: dict[str, pa.DataType] = dict.fromkeys(_OF_VIDEOS, pa.string())
    kinds = pa.schema({**texts, "duration_s": pa.float64()})
    with reading(files):
        read = [parquet.read_table(file, columns=kinds.names) for file in files]
    tables = [rows.select(kinds.names).cast(kinds) for rows in read]
    return pa.concat_tables([kinds.empty_table(), *tables]).combine_chunks()


def _pieces(rows: pa.Table) -> Iterator[pa.Table]:
    """A table cut where it holds too many cues for one go (very long streams)."""
    cues = pc.sum(pc.list_value_length(rows.column("cues"))).as_py() or 0
    if cues > _CUES and rows.num_rows > 1:
        half = rows.num_rows // 2
        yield from _pieces(rows.slice(0, half))
        yield from _pieces(rows.slice(half))
    else:
        yield rows


class _Videos:
    """Lengths (s), channels and topics of videos by id.

    The videos of a file of transcripts are mostly in the file of the same name.
    """

    def __init__(self, path: Path) -> None:
        folder = path.parent.with_name("videos")
        self._same, self._folder = folder / path.name, folder
        self._known: pa.Table | None = None
        self._all = False

    def of(self, ids: pa.ChunkedArray[Any]) -> pa.Table:
        """Rows as `videos` has them, in the order of `ids`; null where no video has one."""
        if self._known is None:
            self._known = videos([self._same] if self._same.exists() else [])
        where = pc.index_in(ids, self._known["video_id"])
        if where.null_count and not self._all:
            self._known, self._all = videos(parquet_files(self._folder)), True
            where = pc.index_in(ids, self._known["video_id"])
        return self._known.take(where)
