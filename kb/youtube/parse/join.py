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

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.store.tables.columns import aligned, column, put

FROM_FILE = "from_file"  # true for a video that only an imported file tells of
IMPORTED = "imported"  # true for a video that an imported file tells of
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
        always = pa.repeat(pa.scalar(True), files.num_rows)
        rows = files.append_column(FROM_FILE, always).append_column(IMPORTED, always)
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
    fresh = aligned(_stamped(statistics), "video_id", column(rows, "video_id"))
    newer = _newer(fresh, rows)
    for name in _OF_ONE:
        rows = put(rows, name, pc.if_else(newer, column(fresh, name), column(rows, name)))
    return rows


def _joined(videos: pa.Table, files: pa.Table) -> pa.Table:
    keys = pc.unique(pa.concat_arrays([column(videos, "video_id"), column(files, "video_id")]))
    keys = keys.take(pc.sort_indices(keys))
    api, file = (aligned(_stamped(one), "video_id", keys) for one in (videos, files))
    newest_first = pc.or_(pc.is_null(column(api, "fetched_at")), _is_after(file, api, "fetched_at"))
    made: dict[str, Any] = {}
    for name in dict.fromkeys([*api.column_names, *file.column_names]):
        if name not in api.column_names or name not in file.column_names:
            made[name] = column(api if name in api.column_names else file, name)
            continue
        a, f = column(api, name), column(file, name)
        made[name] = pc.coalesce(pc.if_else(newest_first, f, a), pc.if_else(newest_first, a, f))
    missing = pc.fill_null(column(api, "missing"), False)
    rows = pa.table({**made, "video_id": keys, "missing": missing})
    rows = rows.append_column(FROM_FILE, pc.is_null(column(api, "fetched_at")))
    rows = rows.append_column(IMPORTED, pc.is_in(keys, value_set=column(files, "video_id")))
    counted = pc.or_(_newer(file, api), pc.is_null(column(api, "view_count")))
    has_views = pc.or_(*(pc.is_valid(column(side, "view_count")) for side in (file, api)))
    for name in _OF_ONE:
        either = pc.if_else(counted, column(file, name), column(api, name))
        rows = put(rows, name, pc.if_else(has_views, either, column(rows, name)))
    return rows


def _newer(one: pa.Table, other: pa.Table) -> pa.Array[Any]:
    """Where `one` has views, and is the newer or the other has none."""
    views = pc.is_valid(column(one, "view_count"))
    alone = pc.is_null(column(other, "view_count"))
    return pc.and_(views, pc.or_(alone, _is_after(one, other, "counted_at")))


def _is_after(one: pa.Table, other: pa.Table, when: str) -> pa.Array[Any]:
    return pc.fill_null(pc.greater(column(one, when), column(other, when)), False)


def _stamped(rows: pa.Table) -> pa.Table:
    """The rows with `counted_at`: an answer's counts are as old as the answer."""
    if "counted_at" in rows.column_names:
        return rows
    return rows.append_column("counted_at", column(rows, "fetched_at"))
