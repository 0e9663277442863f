"""Search: megabytes of text a second, size and a question's time beside FTS5's bare insert, at
shares of the paper's transcripts.

    KB_BENCH_SCALE=0.1 make bench ARGS="-k search"    a tenth of each share, for a quick look

CPU seconds of all threads, so that other work on the machine disturbs the ratios little, and wall
time, as an index is written by threads. Transcripts have real word frequencies
(tests/bench/scale_raw.py); 2,000 different ones are repeated under other ids. Each engine has a
process of its own, whose memory is told.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.schema import table
from kb.search.answers import search
from kb.search.build import index
from kb.search.ranking import Only
from kb.store.layout import Layout
from kb.store.tables.shard_writer import write_table
from kb.youtube import passages as youtube
from tests.bench.scale_raw import Words, _spoken, _vocabulary, video_id
from tests.filters.made import run_at

pytestmark = pytest.mark.bench

VIDEOS = 730_000  # the paper's
SHARES = (0.01, 0.05, 0.20)
DIFFERENT = 2_000
QUESTIONS = 20
_SCALE = float(os.environ.get("KB_BENCH_SCALE", "1"))
_AT_ONCE = 1000
_FILE = 4_000  # videos


def write(root: Path, videos: int) -> None:
    """clean/youtube of so many videos."""
    chance, words = random.Random(1), Words(1)
    different = min(DIFFERENT, videos)
    made = [_cues(_spoken(chance, words)["cues"]) for _ in range(different)]
    kind = table("youtube/transcripts").arrow().field("cues").type
    said = pa.array(made, kind)
    keys = sorted(map(video_id, range(videos)))
    for number, first in enumerate(range(0, videos, _FILE)):
        ids = keys[first : first + _FILE]
        which = pa.array([(first + at) % different for at in range(len(ids))])
        _table(root, "youtube/transcripts", number, {"video_id": ids, "cues": said.take(which)})
        titles = [words.text(8) for _ in ids]
        about = [words.text(90) for _ in ids]
        _table(
            root,
            "youtube/videos",
            number,
            {"video_id": ids, "title": titles, "description": about},
        )


def _cues(given: list[list[Any]]) -> list[dict[str, Any]]:
    return [{"start_s": at, "duration_s": length, "text": text} for at, length, text in given]


def _table(root: Path, name: str, number: int, columns: dict[str, Any]) -> None:
    """A file of a clean table; other columns are null, or nothing."""
    declared = table(name)
    count = len(columns["video_id"])
    arrays = []
    for field in declared.arrow():
        if field.name in columns:
            arrays.append(pa.array(columns[field.name], field.type))
        elif field.nullable:
            arrays.append(pa.nulls(count, field.type))
        else:
            arrays.append(_nothing(field.type, count))
    rows = pa.table(arrays, names=declared.arrow().names)
    write_table(Layout(root).table(name) / f"part-{number:05d}.parquet", rows, declared)


def _nothing(kind: pa.DataType, count: int) -> pa.Array[Any]:
    plain = kind.value_type if isinstance(kind, pa.DictionaryType) else kind
    value: Any = 0
    if pa.types.is_timestamp(plain):
        value = datetime(2023, 1, 1, tzinfo=UTC)
    elif pa.types.is_string(plain):
        value = ""
    elif pa.types.is_list(plain):
        value = []
    elif pa.types.is_boolean(plain):
        value = False
    return pa.array([value] * count, plain).cast(kind)


def questions() -> list[str]:
    """Two to four words each: now and then a frequent one, mostly rarer ones."""
    known = _vocabulary()[0]
    chance = random.Random(5)
    return [
        " ".join(known[int(10 ** chance.uniform(2, 4.2))] for _ in range(chance.randint(2, 4)))
        for _ in range(QUESTIONS)
    ]


class Clock:
    """CPU and wall seconds of what runs inside of `with`, put together."""

    cpu = wall = 0.0

    def __enter__(self) -> None:
        self._begun = time.process_time(), time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.cpu += time.process_time() - self._begun[0]
        self.wall += time.perf_counter() - self._begun[1]


def passages(root: Path) -> Iterator[list[tuple[str, str]]]:
    """Titles and texts, a thousand at a time."""
    every = ((one.title, one.text) for one in youtube.passages(load_profile("minecraft"), root))
    while some := list(islice(every, _AT_ONCE)):
        yield some


def by_kb(root: Path) -> tuple[Clock, Path, Callable[[str], object]]:
    clock = Clock()
    with clock:
        index(run_at(root))
    ten = Only(limit=10)
    return (
        clock,
        Layout(root).index("youtube"),
        lambda words: search(root, words, sources=["youtube"], only=ten),
    )


def by_fts5(root: Path) -> tuple[Clock, Path, Callable[[str], object]]:
    """One table of two columns, as it comes."""
    path, clock = root / "bare.sqlite", Clock()
    con = sqlite3.connect(path)
    con.executescript(
        "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;"
        " CREATE VIRTUAL TABLE found USING fts5(title, text)"
    )
    for some in passages(root):
        with clock:
            con.executemany("INSERT INTO found VALUES (?, ?)", some)
    with clock:
        con.commit()

    def ask(words: str) -> object:
        match = " OR ".join(f'"{word}"' for word in words.split())
        sql = (
            "SELECT rowid, snippet(found, 1, '*', '*', '', 32) FROM found WHERE found MATCH ?"
            " ORDER BY bm25(found, 2, 1) LIMIT 10"
        )
        return con.execute(sql, [match]).fetchall()

    return clock, path, ask


ENGINES = {"kb index": by_kb, "FTS5, bare insert": by_fts5}


def child(root: Path, name: str) -> dict[str, float]:
    """What one engine takes on one root; the process is its own."""
    clock, path, ask = ENGINES[name](root)
    files = [one for one in path.rglob("*") if one.is_file()] if path.is_dir() else [path]
    asked = questions()
    ask(asked[0])
    times = []
    for words in asked:
        begun = time.process_time()
        ask(words)
        times.append(time.process_time() - begun)
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    peak = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))
    return {
        "cpu": clock.cpu,
        "wall": clock.wall,
        "bytes": sum(one.stat().st_size for one in files),
        "median_ms": 1000 * sorted(times)[len(times) // 2],
        "longest_ms": 1000 * max(times),
        "peak_mb": peak / 1024,
    }


def test_search_beside_others(tmp_path: Path) -> None:
    peaks: dict[str, list[float]] = {name: [] for name in ENGINES}
    for share in SHARES:
        root = tmp_path / f"{share}"
        write(root, max(100, int(VIDEOS * share * _SCALE)))
        size = count = 0
        for some in passages(root):
            size += sum(len(title) + len(text) for title, text in some)
            count += len(some)
        megabytes, part = size / 1e6, f"{share * _SCALE:.2%}"
        print(f"\n{part} of the paper: {count:,} passages, {megabytes:.0f} MB of text", flush=True)
        base = 0.0
        for name in ENGINES:
            command = [sys.executable, "-m", "tests.bench.bench_search", str(root), name]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            one = json.loads(done.stdout.splitlines()[-1])
            base = base or one["cpu"]
            peaks[name].append(one["peak_mb"])
            print(
                f"  {name:18} {megabytes / one['cpu']:6.1f} MB/s  {base / one['cpu']:5.2f} ×"
                f"   {megabytes / one['wall']:6.1f} MB/s of wall time"
                f"   {one['bytes'] / size:5.2f} of the text   a question"
                f" {one['median_ms']:7.1f} ms, at most {one['longest_ms']:7.1f}"
                f"   peak {one['peak_mb']:.0f} MB",
                flush=True,
            )
        shutil.rmtree(root)
    # Both read the same way, a few rows of each file ahead; an index's writers have their memory.
    for own, bare in zip(peaks["kb index"], peaks["FTS5, bare insert"], strict=True):
        assert own < bare + 400


if __name__ == "__main__":
    print(json.dumps(child(Path(sys.argv[1]), sys.argv[2])))
