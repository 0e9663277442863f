"""The quality of pairs: figures of a part's own texts first, then what needs all transcripts.

<parts>/quality/<part>.pairs.arrow     figures of texts, and the keys of the runs around each
<parts>/quality/<part>.videos.arrow    the bands of the part's videos
<parts>/quality/<part>.keys.npy        every key of its videos, sorted
<parts>/quality/<part>.parquet         finished rows of pairs/quality
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.installation import np
from kb.pairs.extract import PairBatch
from kb.pairs.quality import near_duplicates, recurring_text, text_figures
from kb.pairs.quality.hashed_words import hashed_words
from kb.pairs.transcript_batch import Text
from kb.store.atomic import writing
from kb.store.tables.shard_writer import sorted_shards, write_table

_TABLE = "pairs/quality"


class BatchQuality(NamedTuple):
    """Of a batch: rows of its pairs, rows of its videos, and the keys of their runs (uint64)."""

    pairs: pa.Table
    videos: pa.Table
    keys: np.ndarray


def of_batch(text: Text, batch: PairBatch, language: str) -> BatchQuality:
    """The figures of a batch's pairs. `language`: the profile's."""
    words = hashed_words(text, batch.matches)
    keys = recurring_text.keys_of(words, text.channels)
    bands = near_duplicates.bands_of(words, len(text))
    within, match = words.between(*batch.text), words.between(*batch.match)
    known = text_figures.known_words(language)
    sure = text_figures.sure(words, known, within)
    codes, confidence = text_figures.languages(batch.rows["text"].combine_chunks(), sure, language)
    verbs = text_figures.has_verb(words, known, within, match) if known is not None else None
    spoken = batch.rows["text"]
    seconds = pc.subtract(batch.rows["text_end_s"], batch.rows["text_start_s"])
    counts = pc.add(pc.count_substring(spoken, " "), 1)
    pairs = pa.table(
        {
            "pair_id": batch.rows["pair_id"],
            "video_id": batch.rows["video_id"],
            "match_start_s": batch.rows["match_start_s"],
            "has_channel": pa.array([one is not None for one in text.channels]).take(
                pa.array(batch.video)
            ),
            "runs": recurring_text.around(keys, *within),
            "language": codes,
            "language_confidence": confidence,
            "has_verb": pa.array(verbs) if verbs is not None else pa.nulls(len(codes), pa.bool_()),
            "keyword_count": pa.array(batch.keywords),
            "interpolation_error_s": _interpolation_error(text, batch),
            "words_per_second": pc.if_else(
                pc.greater(seconds, 0), pc.divide(counts.cast(pa.float64()), seconds), None
            ),
        }
    )
    videos = pa.table(
        {
            "video_id": text.ids.take(pa.array(bands.video)),
            "bands": pa.FixedSizeListArray.from_arrays(
                pa.array(bands.bands.ravel()), near_duplicates.BANDS
            ),
        }
    )
    return BatchQuality(pairs, videos, recurring_text.once_a_video(keys, words.video[: len(keys)]))


def _interpolation_error(text: Text, batch: PairBatch) -> pa.Array[Any]:
    """How much later each match would begin (s) if the words of its cue shared its time evenly;
    null where its own time is known no better.
    """
    at = batch.match[0]
    mine = np.rint(np.asarray(batch.rows["match_start_s"]) * 1000)
    later = (text.shared_out(at) - mine) / 1000
    return cast("pa.Array[Any]", pa.array(later, mask=~text.timed(at)))


def write_part(folder: str, name: str, batches: Sequence[BatchQuality]) -> None:
    """Write what a part knows of its pairs. Raises DiskFull."""
    place = Path(folder, "quality")
    for what, tables in (
        ("pairs", [one.pairs for one in batches]),
        ("videos", [one.videos for one in batches]),
    ):
        rows = pa.concat_tables(tables)
        with (
            writing(place / f"{name}.{what}.arrow") as path,
            pa.OSFile(str(path), "wb") as sink,
            pa.ipc.new_file(sink, rows.schema) as writer,
        ):
            writer.write_table(rows)
    with writing(place / f"{name}.keys.npy") as path, path.open("wb") as file:
        np.save(file, np.sort(np.concatenate([one.keys for one in batches])))


def finish(parts: Sequence[Path], out: Path) -> None:
    """Write pairs/quality of the finished parts (their files of pairs) into `out`.

    What a part left that was killed before its last file is not read: another one may have its
    videos. Raises DiskFull.
    """
    named = [path.parent / "quality" / path.stem for path in parts]
    if not named:  # no transcript was kept
        sorted_shards((), out, _TABLE, released=False)
        return
    recurs = recurring_text.recurring([Path(f"{one}.keys.npy") for one in named])
    duplicates = _duplicates(named)
    made_of_parts: list[Path] = []
    for one in named:
        rows = _read(Path(f"{one}.pairs.arrow"))
        share = pa.array(np.round(recurring_text.shares(_one(rows["runs"]), recurs), 4))
        at = pc.index_in(rows["pair_id"], value_set=_one(duplicates["pair_id"]))
        copies = duplicates.take(at)
        own = {
            "recurring_share": pc.if_else(rows["has_channel"], share, None),
            "duplicate_of": copies["duplicate_of"],
            "duplicate_video_id": copies["duplicate_video_id"],
            "cluster_size": pc.fill_null(copies["cluster_size"], 1),
        }
        made = pa.table({name: rows[name] for name in rows.column_names} | own)
        made_of_parts.append(Path(f"{one}.parquet"))
        write_table(
            made_of_parts[-1],
            made.drop_columns(["runs", "has_channel", "match_start_s"]),
            _TABLE,
            sync=False,
        )
    sorted_shards(made_of_parts, out, _TABLE, released=False)


def _duplicates(parts: Sequence[Path]) -> pa.Table:
    """The pairs of videos that say nearly what another one says: `pair_id`, `duplicate_of`,
    `duplicate_video_id`, `cluster_size`.
    """
    paired: list[pa.Table] = []
    for one in parts:
        rows = _read(Path(f"{one}.pairs.arrow"))
        paired.append(rows.select(["pair_id", "video_id", "match_start_s"]))
    ids = [one["video_id"] for one in paired]
    with_pairs = pc.unique(pa.chunked_array([c for one in ids for c in one.chunks], pa.string()))
    videos = pa.concat_tables(_read(Path(f"{one}.videos.arrow")) for one in parts)
    videos = videos.filter(pc.is_in(videos["video_id"], value_set=with_pairs))
    videos = videos.sort_by("video_id").combine_chunks()
    bands = np.asarray(_one(videos["bands"]).flatten()).reshape(-1, near_duplicates.BANDS)
    first = near_duplicates.firsts(bands)
    clustered = np.bincount(first, minlength=len(first))[first] > 1
    known = _one(videos["video_id"])
    members, heads = known.filter(pa.array(clustered)), known.take(pa.array(first[clustered]))
    pairs = pa.concat_tables(
        one.filter(pc.is_in(one["video_id"], value_set=members)) for one in paired
    )
    pairs = pairs.sort_by([(n, "ascending") for n in ("video_id", "match_start_s", "pair_id")])
    return _nearest(pairs.combine_chunks(), members, heads)


def _nearest(pairs: pa.Table, members: pa.Array[Any], heads: pa.Array[Any]) -> pa.Table:
    """Each pair of a cluster's later videos with the nearest in time of its first video. `pairs`
    are sorted by video and time; `members` are the videos, `heads` the first of each one's cluster.
    """
    video, ids = _one(pairs["video_id"]), _one(pairs["pair_id"])
    head = heads.take(pc.index_in(video, value_set=members))
    is_head = np.asarray(pc.equal(video, head))
    number = np.asarray(pc.index_in(head, value_set=members)).astype(np.int64)
    time = np.rint(np.asarray(_one(pairs["match_start_s"])) * 1000).astype(np.int64)
    mine = np.flatnonzero(is_head)
    key = number * 10**12 + time  # no match is 30 years into a video
    place = np.searchsorted(key[mine], key)
    before = mine[np.maximum(place - 1, 0)] if len(mine) else mine
    behind = mine[np.minimum(place, len(mine) - 1)] if len(mine) else mine
    nearer = np.abs(key[behind] - key) < np.abs(key[before] - key)
    nearest = np.where(is_head, np.arange(len(key)), np.where(nearer, behind, before))
    size = np.bincount(nearest, minlength=len(key))[nearest]
    copy = pa.array(~is_head)
    return pa.table(
        {
            "pair_id": ids,
            "duplicate_of": pc.if_else(copy, ids.take(pa.array(nearest)), None),
            "duplicate_video_id": pc.if_else(copy, video.take(pa.array(nearest)), None),
            "cluster_size": pa.array(size, pa.int64()),
        }
    )


def _read(path: Path) -> pa.Table:
    with pa.memory_map(str(path)) as source:
        return pa.ipc.open_file(source).read_all()


def _one(column: pa.ChunkedArray[Any]) -> Any:
    return column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
