"""How YouTube counted views on the day when a count was read.

Source: revision history of the YouTube Data API, 27 August 2026 (all videos) and 31 March 2025
(Shorts). Whether a video is a Short is in no answer: it is taken to be one when it is not wider
than high and no longer than YouTube let Shorts be when it was published (60 s, since 15 October
2024 three minutes).
"""

from __future__ import annotations

import logging
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.core.installation import pc
from kb.store.layout import parquet_files
from kb.store.tables import parquet
from kb.store.tables.columns import column

WATCH_TIME, PLAYBACK_START = "watch_time", "playback_start"
_ALL_VIDEOS = datetime(2026, 8, 27, tzinfo=UTC)
_SHORTS = datetime(2025, 3, 31, tzinfo=UTC)
_LONG_SHORTS = datetime(2024, 10, 15, tzinfo=UTC)
_SHORT_S, _LONG_SHORT_S = 60, 180

_log = logging.getLogger("kb.youtube")


def view_rule(rows: pa.Table) -> pa.Array[Any]:
    """`watch_time` or `playback_start` of each row; null where `counted_at` is.

    Reads `counted_at`, `published_at`, `width`, `height` (px), `duration_s`.
    """
    read = column(rows, "counted_at")
    since_start = pc.or_(
        pc.greater_equal(read, _moment(_ALL_VIDEOS)),
        pc.and_(_is_short(rows), pc.greater_equal(read, _moment(_SHORTS))),
    )
    return pc.if_else(since_start, PLAYBACK_START, WATCH_TIME)


def _is_short(rows: pa.Table) -> pa.Array[Any]:
    """False where the size or the length is unknown."""
    late = pc.fill_null(
        pc.greater_equal(column(rows, "published_at"), _moment(_LONG_SHORTS)), False
    )
    longest = pc.if_else(late, _LONG_SHORT_S, _SHORT_S)
    upright = pc.less_equal(column(rows, "width"), column(rows, "height"))
    brief = pc.less_equal(column(rows, "duration_s"), longest)
    return pc.fill_null(pc.and_(upright, brief), False)


def kept_counts(clean: Path) -> dict[str, dict[str, int]]:
    """Kept videos by `view_rule` and automatic transcripts by `word_times`, for the summary of a
    filter; warns where views mix two rules.

    `clean` is the folder of the clean tables.
    """
    counts = _kept(clean / "videos", "view_rule")
    if len(counts) > 1:
        _log.warning(
            "view counts mix two definitions: %s kept videos were read when a view needed"
            " watch time and %s when the start of playback counted (column view_rule);"
            " `kb refresh youtube --older-than 0` reads all of them again",
            f"{counts[WATCH_TIME]:,}",
            f"{counts[PLAYBACK_START]:,}",
        )
    return {"view_rules": counts, "word_times": _kept(clean / "transcripts", "word_times")}


def _kept(folder: Path, name: str) -> dict[str, int]:
    """How often each value of a column occurs in a table."""
    counts: Counter[str] = Counter()
    for path in parquet_files(folder):
        values = parquet.read_table(path, columns=[name])[name]
        for entry in pc.value_counts(values.drop_null()).to_pylist():
            counts[entry["values"]] += entry["counts"]
    return dict(sorted(counts.items()))


def _moment(moment: datetime) -> pa.Scalar[Any]:
    return pa.scalar(moment, pa.timestamp("us", "UTC"))
