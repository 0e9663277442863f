"""What reading alone costs: the bytes of a stage decompressed and decoded in one process, by the
quickest typed reader that there is (msgspec's for JSON, DuckDB's for dumps, Arrow's for Parquet).

    python -m tests.bench.scale_floor NAME ROOT        CPU seconds, without the start of Python
"""

from __future__ import annotations

import functools
import gc
import hashlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import duckdb
import msgspec
import pyarrow.parquet as pq
import zstandard


class _Text(msgspec.Struct, gc=False):
    title: str | None = None
    description: str | None = None
    channelId: str | None = None
    publishedAt: str | None = None
    categoryId: str | None = None
    tags: list[str] = []


class _Counts(msgspec.Struct, gc=False):
    viewCount: str | None = None
    likeCount: str | None = None


class _Content(msgspec.Struct, gc=False):
    duration: str | None = None


class _Video(msgspec.Struct, gc=False):
    id: str
    snippet: _Text
    statistics: _Counts
    contentDetails: _Content


class _Videos(msgspec.Struct, gc=False):
    items: list[_Video]


class _VideoAnswer(msgspec.Struct, gc=False):
    response: _Videos


class _Cues(msgspec.Struct, gc=False):
    start_s: list[float]
    duration_s: list[float]
    text: list[str]
    word_start_s: list[list[float] | None] | None = None


class _Transcript(msgspec.Struct, gc=False):
    video_id: str
    outcome: str
    cues: _Cues | None = None


class _TranscriptAnswer(msgspec.Struct, gc=False):
    response: _Transcript


class _Thing(msgspec.Struct, gc=False):
    data: _ThingData


class _ThingData(msgspec.Struct, gc=False):
    id: str | None = None
    name: str | None = None
    author: str | None = None
    title: str | None = None
    selftext: str | None = None
    body: str | None = None
    link_id: str | None = None
    parent_id: str | None = None
    url: str | None = None
    score: int | None = None
    created_utc: float | None = None
    over_18: bool | None = None
    children: list[_Thing] = []
    replies: _Thing | str | None = None


class _ThingAnswer(msgspec.Struct, gc=False):
    response: _Thing | list[_Thing]


class _Element(msgspec.Struct, gc=False):
    id: int
    kind: str
    tag: str
    box: tuple[float, float, float, float]
    text: str | None = None


class _Extraction(msgspec.Struct, gc=False):
    elements: list[_Element]


def _lines(root: Path, source: str, kind: str) -> Iterator[bytes]:
    """Whole segments, decompressed as one stream, and their lines."""
    for path in sorted((root / "raw" / source / kind).glob("*.zst")):
        with path.open("rb") as file:
            engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
            with engine.stream_reader(file, read_across_frames=True) as reader:
                rest = b""
                while chunk := reader.read(1 << 20):
                    *whole, rest = (rest + chunk).split(b"\n")
                    yield from whole


def _decode(root: Path, source: str, kinds: dict[str, Any]) -> None:
    for kind, type_ in kinds.items():
        decoder = msgspec.json.Decoder(type_)
        for line in _lines(root, source, kind):
            decoder.decode(line)


def _parquet(root: Path, *folders: str) -> None:
    for folder in folders:
        for path in sorted((root / folder).glob("*.parquet")):
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(use_threads=False):
                    del batch


def _files(root: Path, *folders: str) -> None:
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.is_file():
                with path.open("rb") as file:
                    hashlib.file_digest(file, "sha256")


def _dumps(root: Path) -> None:
    con = duckdb.connect(config={"threads": 1})
    texts = (
        "id",
        "subreddit",
        "author",
        "title",
        "selftext",
        "body",
        "link_id",
        "parent_id",
        "url",
    )
    columns = dict.fromkeys(texts, "VARCHAR") | {"created_utc": "BIGINT", "score": "BIGINT"}
    for path in sorted((root / "dumps").glob("*.zst")):
        con.execute(
            f"CREATE OR REPLACE TABLE t AS SELECT * FROM read_json('{path}',"
            f" format='newline_delimited', compression='zstd', columns={columns})"
        )


def _pages(root: Path) -> None:
    decoder = msgspec.json.Decoder(_Extraction)
    engine = zstandard.ZstdDecompressor()
    for path in sorted((root / "raw/wiki/pages").glob("*/*/extraction.json.zst")):
        decoder.decode(engine.decompressobj().decompress(path.read_bytes()))


_THINGS = dict.fromkeys(("dumps", "listings", "comments"), _ThingAnswer)
_YOUTUBE = {"videos": _VideoAnswer, "transcripts": _TranscriptAnswer}
_CLEAN = {
    "youtube": ("clean/youtube/videos",),
    "reddit": ("clean/reddit/posts", "clean/reddit/comments"),
    "wiki": ("clean/wiki/pages", "clean/wiki/elements", "clean/wiki/cells", "clean/wiki/images"),
}
FLOORS: dict[str, Callable[[Path], None]] = {
    "youtube filter": lambda root: _decode(root, "youtube", _YOUTUBE),
    "youtube export": lambda root: _parquet(root, *_CLEAN["youtube"]),
    "reddit import": _dumps,
    "reddit filter": lambda root: _decode(root, "reddit", _THINGS),
    "reddit export": lambda root: _parquet(root, *_CLEAN["reddit"]),
    "wiki filter": _pages,
    "wiki export": lambda root: (
        _parquet(root, *_CLEAN["wiki"]),
        _files(root, "raw/wiki/pages"),
    )[0],
    "pairs": lambda root: _parquet(root, "clean/youtube/transcripts"),
    "youtube text": lambda root: _parquet(
        root, "clean/youtube/transcripts", "clean/youtube/videos"
    ),
    "reddit text": lambda root: _parquet(root, *_CLEAN["reddit"]),
    "wiki text": lambda root: _parquet(root, *_CLEAN["wiki"][:3]),
    "release": lambda root: _files(root, "release"),
    "report": lambda root: _parquet(root, *_CLEAN["youtube"], *_CLEAN["reddit"], *_CLEAN["wiki"]),
    **{
        f"{name} {source}": functools.partial(_decode, source=source, kinds=kinds)
        for name in ("replay", "refresh", "gone", "purge")
        for source, kinds in (("youtube", _YOUTUBE), ("reddit", _THINGS))
    },
}


def main(name: str, root: Path) -> None:
    """Print the CPU seconds of a stage's floor."""
    gc.disable()  # nothing that is read has a cycle
    begin = time.process_time()
    FLOORS[name](root)
    print(time.process_time() - begin)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
