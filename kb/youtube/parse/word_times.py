"""Checks the word times of automatic tracks: one start for each word of a cue, in order.

A cue whose starts do not fit loses them and keeps its text; the column `word_times` of
youtube/transcripts says why.
"""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

COMPLETE, ABSENT = "complete", "absent"
MISMATCH, NEGATIVE, UNORDERED = "mismatch", "negative", "unordered"


def checked(
    cues: pa.Array[Any], automatic: pa.Array[Any], words: pa.Array[Any]
) -> tuple[pa.Array[Any], pa.Array[Any]]:
    """The starts of the words of each cue (list of float64; null where the cue has none that can
    be used), and `word_times` of each track.

    `cues`: lists of structs with `word_start_s`; `automatic`: which tracks may have word times;
    `words` (int64): the number of words of each cue, all tracks together.
    """
    flat = pc.list_flatten(cues)
    track = pc.list_parent_indices(cues)
    starts = flat.field("word_start_s")
    starts = pc.if_else(automatic.take(track), starts, pa.scalar(None, starts.type))
    cue, start = pc.list_parent_indices(starts), pc.list_flatten(starts)
    reason = pa.nulls(len(flat), pa.string())
    falling = pc.and_(
        pc.equal(cue.slice(1), cue.slice(0, max(len(cue) - 1, 0))),
        pc.less(start.slice(1), start.slice(0, max(len(start) - 1, 0))),
    )
    unordered = cue.slice(1).filter(falling)
    usable = pc.and_kleene(pc.is_finite(start), pc.greater_equal(start, 0))
    negative = cue.filter(pc.invert(pc.fill_null(usable, False)))
    rows = pa.array(range(len(flat)), pa.int64())
    reason = pc.if_else(pc.is_in(rows, value_set=unordered), UNORDERED, reason)
    reason = pc.if_else(pc.is_in(rows, value_set=negative), NEGATIVE, reason)
    fits = pc.equal(pc.list_value_length(starts).cast(pa.int64()), words)
    reason = pc.if_else(pc.fill_null(fits, True), reason, MISMATCH)
    starts = pc.if_else(pc.is_null(reason), starts, pa.scalar(None, starts.type))
    has_words = pc.and_(pc.is_null(starts), pc.greater(words, 0))
    return starts, _of_tracks(len(cues), track, reason, has_words)


def _of_tracks(
    tracks: int, track: pa.Array[Any], reason: pa.Array[Any], without: pa.Array[Any]
) -> pa.Array[Any]:
    """Why the first cue of each track with words and without word times has none."""
    hit = pc.indices_nonzero(without)
    first = pc.index_in(pa.array(range(tracks), pa.int64()), value_set=track.take(hit))
    why = pc.fill_null(reason.take(hit), ABSENT).take(first)
    return pc.fill_null(why, COMPLETE)
