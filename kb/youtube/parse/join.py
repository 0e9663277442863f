"""Joins all answers about a video into one row.

    videos        videos.list: everything that the Data API has
    statistics    videos.batchGetStats: the counts, read again
    ytdlp_info    an imported file of yt-dlp

A value is the newest answer's, or where that has none the other's: an import replaces nothing
by null. The counts and `counted_at` are of one answer, the newest that has views; `fetched_at` says
how old all the rest is. Only videos.list says that a video is missing: no file brings back what the
service has removed.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

FROM_FILE = "from_file"  # true for a video that only an imported file tells of
COUNTED = ("view_count", "like_count", "comment_count")
_OF_ONE = (*COUNTED, "counted_at")


def one_row_each(
    videos: pa.Table | None, files: pa.Table | None, statistics: pa.Table | None
) -> pa.Table | None:
    """The rows of `videos` and `files` (newest of each `video_id`) joined, by `video_id`.

    Both have the columns of `answers.videos`, `files` also those that only a file has. Statistics
    of other videos are left out. None where there is no video at all.
    """
    if files is None:
        rows = videos
    elif videos is None:
        rows = files.append_column(FROM_FILE, pa.repeat(pa.scalar(True), files.num_rows))
    else:
        rows = _joined(videos, files)
    if rows is None:
        return None
    return _stamped(rows) if statistics is None else with_statistics(rows, statistics)


def with_statistics(rows: pa.Table, statistics: pa.Table) -> pa.Table:
    """The rows with the counts of `statistics` where these are newer and have views."""
    rows = _stamped(rows)
    if not statistics.num_rows:
        return rows
    fresh = aligned(_stamped(statistics), _one(rows, "video_id"))
    newer = _newer(fresh, rows)
    for name in _OF_ONE:
        rows = _with(rows, name, pc.if_else(newer, _one(fresh, name), _one(rows, name)))
    return rows


def aligned(rows: pa.Table, keys: pa.Array[Any]) -> pa.Table:
    """The row of each key in `video_id`; nulls for a key without one."""
    if not rows.num_rows:
        return pa.table({field.name: pa.nulls(len(keys), field.type) for field in rows.schema})
    return rows.take(pc.index_in(keys, value_set=_one(rows, "video_id"))).combine_chunks()


def _joined(videos: pa.Table, files: pa.Table) -> pa.Table:
    keys = pc.unique(pa.concat_arrays([_one(videos, "video_id"), _one(files, "video_id")]))
    keys = keys.take(pc.sort_indices(keys))
    api, file = aligned(_stamped(videos), keys), aligned(_stamped(files), keys)
    newest_first = pc.or_(pc.is_null(_one(api, "fetched_at")), _is_after(file, api, "fetched_at"))
    made: dict[str, Any] = {}
    for name in _names(api, file):
        if name not in api.column_names or name not in file.column_names:
            made[name] = _one(api if name in api.column_names else file, name)
            continue
        a, f = _one(api, name), _one(file, name)
        made[name] = pc.coalesce(pc.if_else(newest_first, f, a), pc.if_else(newest_first, a, f))
    rows = pa.table({**made, "video_id": keys, "missing": _missing(api)})
    rows = rows.append_column(FROM_FILE, pc.is_null(_one(api, "fetched_at")))
    counted = pc.or_(_newer(file, api), pc.is_null(_one(api, "view_count")))
    for name in _OF_ONE:
        either = pc.if_else(counted, _one(file, name), _one(api, name))
        rows = _with(rows, name, pc.if_else(_counts(file, api), either, _one(rows, name)))
    return rows


def _counts(*tables: pa.Table) -> pa.Array[Any]:
    """Where any of the tables has views."""
    there = [pc.is_valid(_one(table, "view_count")) for table in tables]
    any_of: pa.Array[Any] = there[0]
    for one in there[1:]:
        any_of = pc.or_(any_of, one)
    return any_of


def _newer(one: pa.Table, other: pa.Table) -> pa.Array[Any]:
    """Where `one` has views, and is the newer or the other has none."""
    views = pc.is_valid(_one(one, "view_count"))
    alone = pc.is_null(_one(other, "view_count"))
    newer: pa.Array[Any] = pc.and_(views, pc.or_(alone, _is_after(one, other, "counted_at")))
    return newer


def _is_after(one: pa.Table, other: pa.Table, when: str) -> pa.Array[Any]:
    after: pa.Array[Any] = pc.fill_null(pc.greater(_one(one, when), _one(other, when)), False)
    return after


def _stamped(rows: pa.Table) -> pa.Table:
    """The rows with `counted_at`: an answer's counts are as old as the answer."""
    if "counted_at" in rows.column_names:
        return rows
    return rows.append_column("counted_at", _one(rows, "fetched_at"))


def _missing(api: pa.Table) -> pa.Array[Any]:
    missing: pa.Array[Any] = pc.fill_null(_one(api, "missing"), False)
    return missing


def _names(*tables: pa.Table) -> Iterable[str]:
    return dict.fromkeys(name for table in tables for name in table.column_names)


def _with(rows: pa.Table, name: str, values: Any) -> pa.Table:
    return rows.set_column(rows.column_names.index(name), name, values)


def _one(rows: pa.Table, name: str) -> Any:
    column = rows.column(name)
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
