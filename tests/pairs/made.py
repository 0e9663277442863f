"""Invented transcripts: words by Zipf's law, now and then a keyword, cues as YouTube makes them."""

from pathlib import Path

import numpy as np
import pyarrow as pa

from kb.schema import table
from kb.store.tables.shard_writer import write_table

PHRASES = ["creeper", "oak log", "Iron Golem", "bed", "nether portals", "[Música]", "chest", ">>"]

_LETTERS = np.frombuffer(b"etaoinshrdlucmfwypvbgkjqxz", np.uint8)
_WORDS_A_CUE = 8
COMMON = [
    "so",
    "we",
    "are",
    "going",
    "to",
    "get",
    "some",
    "of",
    "the",
    "and",
    "you",
    "can",
    "see",
    "that",
    "i",
    "have",
    "a",
    "lot",
    "it",
    "is",
    "right",
    "here",
    "let's",
    "go",
    "ahead",
    "then",
    "this",
    "one",
    "just",
    "like",
    "in",
    "my",
    "world",
    "now",
    "what",
    "want",
    "make",
    "sure",
    "guys",
    "hey",
    "everyone",
    "welcome",
    "back",
    "today",
    "video",
    "because",
    "really",
    "little",
    "bit",
    "over",
    "there",
]


def vocabulary(size: int, seed: int = 7) -> list[str]:
    """Made-up words, the frequent ones real and short."""
    rng = np.random.default_rng(seed)
    made = []
    for length in rng.integers(3, 10, size):
        made.append(
            _LETTERS[rng.integers(0, 26, length) * rng.integers(1, 27, length) // 27]
            .tobytes()
            .decode()
        )
    return [*COMMON, *made]


def words(
    count: int, phrases: list[str], share: float, seed: int, vocabulary_size: int = 20_000
) -> np.ndarray:
    """`count` words or phrases; about `share` of them are `phrases`,
    a few of these far more often than the rest.
    """
    rng = np.random.default_rng(seed)
    plain = np.asarray(vocabulary(vocabulary_size), object)
    chosen = plain[_zipf(rng, count, len(plain))]
    hits = np.flatnonzero(rng.random(count) < share)
    shuffled = np.random.default_rng(11).permutation(np.asarray(phrases, object))
    chosen[hits] = shuffled[_zipf(rng, len(hits), len(shuffled))]
    return chosen


def _zipf(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    """Ranks with frequencies as in speech (Zipf-Mandelbrot)."""
    weight = np.cumsum(1 / (np.arange(size) + 2.7))
    return np.searchsorted(weight, rng.random(count) * weight[-1])


def tables(
    videos: int, words_each: int, phrases: list[str], share: float = 0.03, seed: int = 0
) -> tuple[pa.Table, pa.Table]:
    """(youtube/transcripts, video_id and duration_s of youtube/videos)."""
    rng = np.random.default_rng(seed + 1)
    sizes = (
        np.maximum(1, rng.gamma(2, words_each / 2, videos).astype(int))
        if words_each > 50
        else np.full(videos, words_each)
    )
    stream = words(int(sizes.sum()), phrases, share, seed)
    ids, kinds, cues, lengths = [], [], [], []
    at = 0
    for video, size in enumerate(sizes.tolist()):
        mine = stream[at : at + size]
        at += size
        made = [
            {
                "start_s": round(place * 0.47 * _WORDS_A_CUE / 8 + 0.2, 2),
                "duration_s": 5.0,
                "text": " ".join(mine[place : place + _WORDS_A_CUE]),
            }
            for place in range(0, size, _WORDS_A_CUE)
        ]
        ids.append(f"v{seed % 1000:03d}{video:07d}")
        kinds.append(("asr", "asr", "asr", "manual", "translated")[video % 5])
        cues.append(made)
        lengths.append(float(round(size * 0.47 / 8 * _WORDS_A_CUE + 20)))
    schema = table("youtube/transcripts").arrow()
    transcripts = pa.table(
        {
            "video_id": ids,
            "kind": kinds,
            "language": ["en"] * videos,
            "cues": pa.array(cues, schema.field("cues").type),
            "word_times": pa.nulls(videos, pa.string()),
            "read_from": ["watch_page"] * videos,
            "fetched_at": pa.nulls(videos, schema.field("fetched_at").type),
        },
        schema=schema,
    )
    return transcripts, pa.table({"video_id": ids, "duration_s": pa.array(lengths, pa.float64())})


def shards(folder: Path) -> list[Path]:
    """The files of pairs/pairs in a folder that has pairs/quality too."""
    return sorted(folder.glob("pairs-*.parquet"))


def fill(root: Path, transcripts: pa.Table, lengths: pa.Table, make_rows, files: int = 2) -> None:
    """Write clean/youtube with these transcripts, spread over `files` files."""
    for number in range(files):
        mine = np.arange(number, transcripts.num_rows, files)
        write_table(
            root / f"clean/youtube/transcripts/part-{number:05d}.parquet",
            transcripts.take(mine),
            "youtube/transcripts",
        )
        rows = make_rows(
            "youtube/videos",
            len(mine),
            video_id=lengths["video_id"].take(mine).to_pylist(),
            duration_s=lengths["duration_s"].take(mine).to_pylist(),
        )
        write_table(
            root / f"clean/youtube/videos/part-{number:05d}.parquet", rows, "youtube/videos"
        )
