"""The quality of pairs: figures of a part's own texts first, then what needs all transcripts.

<parts>/quality/<part>.pairs.arrow     figures of texts, and the keys of the runs around each
<parts>/quality/<part>.videos.arrow    the bands of the part's videos
<parts>/quality/<part>.keys.npy        every key of its videos, sorted
<parts>/quality/<part>.parquet         finished rows of pairs/quality

Figures of one pair's text: its language, a verb near the keyword, keywords, words a second.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.installation import np
from kb.pairs import repeated_text
from kb.pairs.extract import PairBatch
from kb.pairs.repeated_text import HashedWords, hash_of, hashed_words, is_among
from kb.pairs.transcript_batch import Text
from kb.store.atomic import writing
from kb.store.tables.shard_writer import sorted_shards, write_table

if TYPE_CHECKING:
    from lingua import LanguageDetector

_TABLE = "pairs/quality"

FASTEST_SPEECH = 5.5  # words a second that nobody speaks over the length of a video
NEAR = 5  # words before and after the keyword in which a verb is looked for
_ENOUGH = 0.1  # share of function words that decides the language
_FOLDER = Path(__file__).with_name("data")
# What is spoken most in videos; each language more costs time and memory for every text.
_LANGUAGES = (
    "arabic", "chinese", "dutch", "english", "french", "german", "hindi", "indonesian", "italian",
    "japanese", "korean", "polish", "portuguese", "russian", "spanish", "swedish", "turkish",
    "vietnamese",
)  # fmt: skip


def of_batch(text: Text, batch: PairBatch, language: str) -> tuple[pa.Table, pa.Table, np.ndarray]:
    """Of a batch: rows of its pairs, rows of its videos, and the keys of their runs (uint64).
    `language`: the profile's.
    """
    words = hashed_words(text, batch.matches)
    keys = repeated_text.keys_of(words, text.channels)
    video, bands = repeated_text.bands_of(words, len(text))
    within, match = words.between(*batch.text), words.between(*batch.match)
    known = known_words(language)
    in_own = sure(words, known, within)
    codes, confidence = languages(batch.rows["text"].combine_chunks(), in_own, language)
    verbs = has_verb(words, known, within, match) if known is not None else None
    spoken = batch.rows["text"]
    seconds = pc.subtract(batch.rows["text_end_s"], batch.rows["text_start_s"])
    counts = pc.add(pc.count_substring(spoken, " "), 1)
    # How much later (s) each match would begin if the words of its cue shared its time evenly; null
    # where its own time is known no better.
    at, mine = batch.match[0], np.rint(np.asarray(batch.rows["match_start_s"]) * 1000)
    rates = pa.array(np.round(text.words_per_second, 4), from_pandas=True)
    later_s = pa.array((text.shared_out(at) - mine) / 1000, mask=~text.timed(at))
    pairs = pa.table(
        {
            "pair_id": batch.rows["pair_id"],
            "video_id": batch.rows["video_id"],
            "match_start_s": batch.rows["match_start_s"],
            "clip_start_s": batch.rows["clip_start_s"],
            "channel_id": pa.array(text.channels, pa.string()).take(pa.array(batch.video)),
            "runs": repeated_text.around(keys, *within),
            "language": codes,
            "language_confidence": confidence,
            "has_verb": pa.array(verbs) if verbs is not None else pa.nulls(len(codes), pa.bool_()),
            "keyword_count": pa.array(batch.keywords),
            "interpolation_error_s": later_s,
            "words_per_second": pc.if_else(
                pc.greater(seconds, 0), pc.divide(counts.cast(pa.float64()), seconds), None
            ),
            "video_words_per_second": rates.take(pa.array(batch.video)),
        }
    )
    videos = pa.table(
        {
            "video_id": text.ids.take(pa.array(video)),
            "bands": pa.FixedSizeListArray.from_arrays(
                pa.array(bands.ravel()), repeated_text.BANDS
            ),
        }
    )
    return pairs, videos, repeated_text.once_a_video(keys, words.video[: len(keys)])


def write_part(
    folder: str, name: str, batches: Sequence[tuple[pa.Table, pa.Table, np.ndarray]]
) -> None:
    """Write what a part knows of its pairs. Raises DiskFull."""
    place = Path(folder, "quality")
    pairs, videos, keys = zip(*batches, strict=True)
    for what, tables in (("pairs", pairs), ("videos", videos)):
        rows = pa.concat_tables(tables)
        with (
            writing(place / f"{name}.{what}.arrow") as path,
            pa.OSFile(str(path), "wb") as sink,
            pa.ipc.new_file(sink, rows.schema) as writer,
        ):
            writer.write_table(rows)
    with writing(place / f"{name}.keys.npy") as path, path.open("wb") as file:
        np.save(file, np.sort(np.concatenate(keys)))


def finish(parts: Sequence[Path], out: Path) -> None:
    """Write pairs/quality of the parts (their files of pairs) into `out`. Raises DiskFull."""
    named = [path.parent / "quality" / path.stem for path in parts]
    if not named:  # no transcript was kept
        sorted_shards((), out, _TABLE, released=False)
        return
    recurs = repeated_text.recurring([Path(f"{part}.keys.npy") for part in named])
    duplicates, sizes = _duplicates(named), _channel_sizes(named)
    made_of_parts: list[Path] = []
    for part in named:
        rows = _read(Path(f"{part}.pairs.arrow"))
        of_channel = sizes["videos"].take(pc.index_in(rows["channel_id"], sizes["channel_id"]))
        videos = np.asarray(pc.fill_null(of_channel, 0))
        share = pa.array(np.round(repeated_text.shares(_one(rows["runs"]), recurs, videos), 4))
        at = pc.index_in(rows["pair_id"], value_set=_one(duplicates["pair_id"]))
        copies = duplicates.take(at)
        own = {
            "recurring_share": pc.if_else(pc.is_valid(rows["channel_id"]), share, None),
            "duplicate_of": copies["duplicate_of"],
            "duplicate_video_id": copies["duplicate_video_id"],
            "cluster_size": pc.fill_null(copies["cluster_size"], 1),
        }
        made = pa.table({name: rows[name] for name in rows.column_names} | own)
        made_of_parts.append(Path(f"{part}.parquet"))
        write_table(
            made_of_parts[-1],
            made.drop_columns(["runs", "channel_id", "match_start_s"]),
            _TABLE,
            sync=False,
        )
    sorted_shards(made_of_parts, out, _TABLE, released=False)


def _channel_sizes(parts: Sequence[Path]) -> pa.Table:
    """How many videos with pairs each channel has: `channel_id`, `videos`."""
    channel_videos = [
        _read(Path(f"{part}.pairs.arrow")).group_by(["channel_id", "video_id"]).aggregate([])
        for part in parts
    ]
    counted = (
        pa.concat_tables(channel_videos).group_by("channel_id").aggregate([("video_id", "count")])
    )
    return counted.rename_columns({"video_id_count": "videos"}).combine_chunks()


def _duplicates(parts: Sequence[Path]) -> pa.Table:
    """The pairs of videos that say nearly what another one says: `pair_id`, `duplicate_of`,
    `duplicate_video_id`, `cluster_size`.
    """
    paired: list[pa.Table] = []
    for part in parts:
        rows = _read(Path(f"{part}.pairs.arrow"))
        paired.append(rows.select(["pair_id", "video_id", "match_start_s"]))
    ids = [rows["video_id"] for rows in paired]
    with_pairs = pc.unique(
        pa.chunked_array([c for column in ids for c in column.chunks], pa.string())
    )
    videos = pa.concat_tables(_read(Path(f"{part}.videos.arrow")) for part in parts)
    videos = videos.filter(pc.is_in(videos["video_id"], value_set=with_pairs))
    videos = videos.sort_by("video_id").combine_chunks()
    bands = np.asarray(_one(videos["bands"]).flatten()).reshape(-1, repeated_text.BANDS)
    first = repeated_text.firsts(bands)
    clustered = np.bincount(first, minlength=len(first))[first] > 1
    known = _one(videos["video_id"])
    members, heads = known.filter(pa.array(clustered)), known.take(pa.array(first[clustered]))
    pairs = pa.concat_tables(
        rows.filter(pc.is_in(rows["video_id"], value_set=members)) for rows in paired
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


@cache
def known_words(language: str) -> dict[str, np.ndarray] | None:
    """Sorted hashes (uint64) of a language's `function_words` and `verbs`, as data/<language>.toml
    lists them; None where there is no list.
    """
    path = _FOLDER / f"{language}.toml"
    if not path.is_file():
        return None
    given = tomllib.loads(path.read_text(encoding="utf-8"))
    return {
        name: np.array(sorted(map(hash_of, words.split())), np.uint64)
        for name, words in given.items()
    }


def counted(words: HashedWords, known: np.ndarray) -> np.ndarray:
    """How many of the known words come before each word, and before the end (int64)."""
    return np.concatenate(([0], np.cumsum(is_among(words.hash, known))))


def has_verb(
    words: HashedWords,
    known: Mapping[str, np.ndarray],
    text: tuple[np.ndarray, np.ndarray],
    match: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Whether a verb stands in the text, at most five words from the keyword and not in it.

    `text`, `match`: the first word of each text and phrase, and the one after its last.
    """
    before = counted(words, known["verbs"])
    low = np.maximum(text[0], match[0] - NEAR)
    high = np.minimum(text[1], match[1] + NEAR)
    around = before[np.maximum(high, low)] - before[low]
    return around > before[match[1]] - before[match[0]]


def languages(
    texts: pa.Array[Any], sure: np.ndarray, language: str
) -> tuple[pa.Array[Any], pa.Array[Any]]:
    """ISO 639-1 code of each text, and the model's confidence (0 to 1).

    `sure`: texts whose function words say that they are in `language`; their confidence is null, as
    is the language of a text without words of any language.
    """
    codes: list[str | None] = [language] * len(texts)
    confidence: list[float | None] = [None] * len(texts)
    for row in np.flatnonzero(~sure).tolist():
        codes[row], confidence[row] = detected(texts[row].as_py() or "")
    return pa.array(codes, pa.string()), pa.array(confidence, pa.float64())


def detected(text: str) -> tuple[str | None, float | None]:
    """A text's language by the model, and its confidence, rounded so that processors agree."""
    best = _detector().compute_language_confidence_values(text)[0]
    if not best.value:
        return None, None
    code: str = best.language.iso_code_639_1.name.lower()
    return code, round(best.value, 2)


@cache
def _detector() -> LanguageDetector:
    from lingua import Language, LanguageDetectorBuilder  # noqa: PLC0415  an extra's, and large

    known = [getattr(Language, name.upper()) for name in _LANGUAGES]
    return LanguageDetectorBuilder.from_languages(*known).with_low_accuracy_mode().build()


def sure(
    words: HashedWords, known: Mapping[str, np.ndarray] | None, text: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Which texts are in the language of the known words by its function words."""
    if known is None:
        return np.zeros(len(text[0]), bool)
    before = counted(words, known["function_words"])
    return (before[text[1]] - before[text[0]]) >= np.maximum(3, _ENOUGH * (text[1] - text[0]))
