"""Raw answers of YouTube → columns. The fields are those that `schemas/tables/youtube/` names in
`from`.

`videos` and `transcripts` read whole segments into Arrow tables, a batch at a time; the small
functions below them read one decoded answer, for the crawl's frontier. A bad value never raises:
it is null in its column and named in `problems`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from itertools import islice
from typing import Any

import pyarrow as pa

from kb.core.errors import FatalError
from kb.core.installation import pc
from kb.schema.coerce import inner, times
from kb.schema.decode import AnswerRows, ColumnReader, problems, rows_of
from kb.schema.tables import table
from kb.store.rawlog.rawlog import Envelope

FORMAT = 2  # of answers about transcripts; raise it when their form changes
PO_TOKEN = "po_token"  # outcome: the track can be had only with a proof-of-origin token
AGAIN = pa.array(["failed", PO_TOKEN])  # outcomes that are tried again


def videos(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Envelopes of videos.list → one row for each video that was returned or asked for.

    Columns: those of youtube/videos that come from the answer, `embed_width`, `embed_height`
    (px), `yt_rating`, `fetched_at`, `problems`, and `missing`: true for an id that was asked for
    and not returned (all else null). A row without a readable id looks like a missing
    one and counts as such.
    """
    reader = _reader("youtube/videos", "videos")
    for got, answers in reader.tables(lines):
        yield from _with_missing(got, answers)


def videos_of(envelope: Envelope) -> Iterator[pa.Table]:
    """The same of one decoded envelope."""
    reader = _reader("youtube/videos", "videos")
    if envelope.status == 200:
        params, response = envelope.request.params, envelope.response
        answer = reader.decoded(envelope.fetched_at, params, envelope.status, response)
        yield from _with_missing(reader.table([answer]), rows_of([answer]))


def statistics(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Envelopes of videos.batchGetStats → `video_id`, the counts and `fetched_at` of each video
    that was returned.
    """
    for got, _ in _reader("youtube/videos", "statistics", note_absent=False).tables(lines):
        yield got.filter(pc.is_valid(got["video_id"])).drop_columns(["problems"])


def _with_missing(got: pa.Table, answers: list[AnswerRows]) -> Iterator[pa.Table]:
    """The rows that have an id, and one for each id that was asked for and not returned."""
    ids = iter(got["video_id"].to_pylist())
    absent = [
        (key, answer)
        for answer in answers
        for there in [set(islice(ids, answer.size))]
        for key in requested(answer.params)
        if key not in there
    ]
    got = got.filter(pc.is_valid(got["video_id"]))
    got = got.append_column("missing", pa.repeat(pa.scalar(False), got.num_rows))
    yield got
    if absent:
        own = {
            "video_id": pa.array([key for key, _ in absent], pa.string()),
            "fetched_at": times([answer.fetched_at for _, answer in absent])[0],
            "missing": pa.repeat(pa.scalar(True), len(absent)),
            "problems": problems({}, len(absent)),
        }
        columns = [
            own[field.name] if field.name in own else pa.nulls(len(absent), field.type)
            for field in got.schema
        ]
        yield pa.table(columns, schema=got.schema)


def transcripts(lines: Iterable[bytes]) -> Iterator[pa.Table]:
    """Outcomes of transcripts → one row each.

    Columns: `video_id`, `outcome`, `kind`, `language`, `cues`, `player_width`, `player_height`
    (px), `player_fps`, `game_label_id`, `game_label`, `fetched_at`, `problems`, and `final`: false
    for an outcome that is tried again. Raises FatalError for answers of another raw format.
    """
    for got, _ in _reader("youtube/transcripts", "transcripts", note_absent=False).tables(lines):
        form = pc.fill_null(got["format"], 1)
        other = form.filter(pc.and_(pc.equal(got["outcome"], "ok"), pc.not_equal(form, FORMAT)))
        for number in other.to_pylist():
            raise FatalError(
                f"raw/youtube has transcripts of raw format {number}; this version of"
                f" Lorecrawl reads format {FORMAT}",
                hint="crawl them again into a new data root",
            )
        final = is_final(got["outcome"])
        yield got.drop_columns(["format"]).append_column("final", final)


def is_final(outcome: Any) -> Any:
    """Which outcomes are not tried again; no outcome is none of these."""
    return pc.and_(pc.is_valid(outcome), pc.invert(pc.is_in(outcome, AGAIN)))


def requested(params: dict[str, Any]) -> list[str]:
    """The ids that a request for videos or statistics asked for, in its order."""
    ids = params.get("id") or ""
    return [key for key in (ids.split(",") if isinstance(ids, str) else ids) if key]


def missing(params: dict[str, Any], response: Any) -> list[str]:
    """Ids that were asked for and are not in the answer: the API leaves them out without a word."""
    there = {item.get("id") for item in items_of(response)}
    return [key for key in requested(params) if key not in there]


def listed(response: Any) -> list[str]:
    """Video ids of a playlistItems.list answer, in its order; entries without one are left out."""
    return [key for item in items_of(response) if (key := listed_video(item)) is not None]


def listed_video(item: Any) -> str | None:
    """The video of an entry of a playlistItems.list answer."""
    key = inner(item, "contentDetails", "videoId") or inner(
        item, "snippet", "resourceId", "videoId"
    )
    return key if isinstance(key, str) and key else None


def channel_hits(response: Any) -> list[str]:
    """Channel ids of a search.list answer (type channel), in its order."""
    hits = (
        inner(item, "id", "channelId") or inner(item, "snippet", "channelId")
        for item in items_of(response)
    )
    return [key for key in hits if isinstance(key, str) and key]


def playlist_hits(response: Any) -> list[str]:
    """Playlist ids of a search.list answer (type playlist), in its order."""
    hits = (inner(item, "id", "playlistId") for item in items_of(response))
    return [key for key in hits if isinstance(key, str) and key]


def next_page(response: Any) -> str | None:
    """The token of the next page; None on the last one."""
    token = response.get("nextPageToken") if isinstance(response, dict) else None
    return token if isinstance(token, str) and token else None


@cache
def _reader(name: str, kind: str, *, note_absent: bool = True) -> ColumnReader:
    return ColumnReader(table(name), kind, note_absent=note_absent)


def items_of(response: Any) -> list[dict[str, Any]]:
    """The items of an answer of the Data API."""
    items = response.get("items") if isinstance(response, dict) else None
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []
