"""Replays the raw log into the frontier, many answers at a time; the result is that of the reducer.

Only the fields that kb.youtube.connector.reduce reads are decoded, and their changes are committed
together, so that rebuilding a state costs little more than reading the log.
"""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, TypedDict

import msgspec
import pyarrow as pa

from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier
from kb.store.tables.latest import newest
from kb.youtube.connector.reduce import (
    RAW_INFO,
    RAW_STATISTICS,
    RAW_TRANSCRIPTS,
    RAW_VIDEOS,
    REFRESH,
    UNJUDGED,
    VIDEOS,
    Reducer,
    note_transcripts,
)
from kb.youtube.parse import answers as parse
from kb.youtube.parse.join import COUNTED, with_statistics
from kb.youtube.ytdlp import info

_AT_ONCE = 1_000  # answers; they are not held, only what they say


class _Outcome(TypedDict, total=False):
    video_id: Any
    outcome: Any
    reason: Any


class _Transcript(Envelope):
    response: _Outcome


class _Videos(Envelope):
    response: msgspec.Raw


_transcripts, _videos = msgspec.json.Decoder(_Transcript), msgspec.json.Decoder(_Videos)


def take_in(reducer: Reducer, frontier: Frontier, kind: str, lines: Iterable[bytes]) -> bool:
    """Take in lines of one raw kind; False, with none read, where that is for the reducer alone.

    Raises DamagedData for a line that is no envelope.
    """
    if kind == RAW_TRANSCRIPTS:
        envelopes: Iterator[Any] = (rawlog.decode_as(_transcripts, line) for line in lines)
        while some := list(islice(envelopes, _AT_ONCE)):
            note_transcripts(frontier, some)
        return True
    if kind != RAW_VIDEOS or reducer.wants:
        return False
    params = (rawlog.decode_as(_videos, line).request.params for line in lines)
    while some := list(islice(params, _AT_ONCE)):
        asked = [key for each in some for key in parse.requested(each)]
        frontier.add(VIDEOS, asked)
        frontier.done(VIDEOS, *asked)
        frontier.done(REFRESH, *asked)
        frontier.set_cursor(UNJUDGED, True)
    return True


def judge(reducer: Reducer, root: Path, frontier: Frontier) -> None:
    """Have videos judged that were taken in by what asks for no transcript, such as a refresh.

    Else a crawl would never ask for their transcripts. Raises DamagedData.
    """
    if not reducer.wants or not frontier.cursor(UNJUDGED, False):
        return
    counts = _newest_counts(root)
    for path in rawlog.segments(root, "youtube", RAW_VIDEOS):
        with frontier.transaction():
            for _, line in rawlog.Frames(path, 0, checked=True):
                for rows in parse.videos_of(rawlog.decode(line)):
                    reducer.judge(frontier, with_statistics(rows, counts))
    for path in rawlog.segments(root, "youtube", RAW_INFO):
        for rows in info.rows(line for _, line in rawlog.Frames(path, 0, checked=True)):
            reducer.judge(frontier, with_statistics(rows, counts))
    frontier.set_cursor(UNJUDGED, None)


def _newest_counts(root: Path) -> pa.Table:
    """The counts that were read by themselves: one row a video, about 50 bytes each."""
    tables = [
        rows
        for path in rawlog.segments(root, "youtube", RAW_STATISTICS)
        for rows in parse.statistics(line for _, line in rawlog.Frames(path, 0, checked=True))
    ]
    names = ["video_id", *COUNTED, "fetched_at"]
    if not tables:
        return pa.table({name: pa.nulls(0) for name in names})
    return newest(pa.concat_tables(tables).select(names), ("video_id",), ("fetched_at",))
