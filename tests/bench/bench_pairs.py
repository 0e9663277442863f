"""Pairs: words a second beside other ways to match, and time and memory at shares of the paper's
scale.

    KB_BENCH_SCALE=0.1 make bench ARGS="-k pairs"    a tenth of each share, for a quick look

CPU seconds of one core, so that other work on the machine disturbs the ratios little. Transcripts
are invented (Zipf's law, keywords mixed in); at scale, 2,000 different ones are repeated under
other ids.
"""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.pairs.extract import make_tools, pairs_of
from kb.pairs.keywords import load
from kb.pairs.matching import Folded, leftmost_longest
from kb.pairs.transcript_batch import Text
from kb.store.tables.shard_writer import ShardWriter, write_table
from tests.bench.measured import words_a_second
from tests.pairs.made import tables

pytestmark = pytest.mark.bench

VIDEOS, WORDS = 730_000, 2_200_000_000  # the paper's
SHARES = (0.01, 0.03, 0.10)
DIFFERENT = 2_000
_SCALE = float(os.environ.get("KB_BENCH_SCALE", "1"))


class Said(NamedTuple):
    """Transcripts: as a table, as texts, and folded into plain lower-case words for those that
    can't do it themselves.
    """

    rows: pa.Table
    lengths: pa.Array
    plain: list[str]
    words: int


@pytest.fixture(scope="module")
def tools():
    profile = load_profile("minecraft")
    return make_tools(profile.section("pairs"), profile.seed, load(profile))


@pytest.fixture(scope="module")
def said(tools) -> Said:
    rows, lengths = tables(330, 3000, [keyword.name for keyword in tools.keywords.every])
    plain = Folded(Text(rows).raw).bytes.split(b"\xff")
    texts = [one.decode() for one in plain]
    return Said(
        rows, lengths["duration_s"].combine_chunks(), texts, sum(len(one.split()) for one in texts)
    )


def _part(said: Said, words: int) -> tuple[list[str], int]:
    """About as many words, for the slow ones."""
    texts, total = [], 0
    for text in said.plain:
        texts.append(text)
        total += len(text.split())
        if total >= words:
            break
    return texts, total


def _show(title: str, rates: dict[str, float], base: str) -> None:
    print(f"\n{title}")
    for name, rate in sorted(rates.items(), key=lambda item: item[1]):
        print(f"  {name:42} {rate / 1e6:9.3f} M words/s  {rate / rates[base]:8.1f} ×")


def test_pairs_matching_and_pipeline(said: Said, tools) -> None:
    phrases = sorted(tools.keywords.phrases, key=len, reverse=True)
    rates: dict[str, float] = {}
    hits: dict[str, float] = {}
    alternation = re.compile(r"\b(?:" + "|".join(map(re.escape, phrases)) + r")\b")
    texts, words = _part(said, 8_000)
    begin = time.process_time()
    hits["one re alternation"] = sum(len(alternation.findall(text)) for text in texts) / words
    rates["one re alternation"] = words / (time.process_time() - begin)

    raw = Text(said.rows).raw
    rates["kb: fold + match + resolve"] = words_a_second(
        said.words, lambda: tools.keywords.matcher.find(raw)
    )
    found = tools.keywords.matcher.find(raw)
    hits["kb: fold + match + resolve"] = len(found.phrase) / said.words
    few = b" " + " \xff ".join(texts).encode("latin-1") + b" "
    assert len(tools.keywords.matcher.find(few).phrase) == round(
        hits["one re alternation"] * words
    )  # the same matches

    rates["kb: whole pipeline with CLIP tokens"] = words_a_second(
        said.words, lambda: pairs_of(Text(said.rows, said.lengths), tools)
    )
    _flashtext(said, phrases, rates, hits)
    _pyahocorasick(said, phrases, rates, hits)
    _duckdb(said, phrases, rates)
    _show(
        f"{len(phrases):,} phrases, {said.words:,} words, a match in"
        f" {1 / hits['kb: fold + match + resolve']:.0f} words",
        rates,
        "one re alternation",
    )
    print("  matches a word: " + ", ".join(f"{name} {share:.4f}" for name, share in hits.items()))
    assert rates["kb: fold + match + resolve"] >= 300 * rates["one re alternation"]
    assert rates["kb: whole pipeline with CLIP tokens"] >= 90 * rates["one re alternation"]


def _flashtext(
    said: Said, phrases: list[str], rates: dict[str, float], hits: dict[str, float]
) -> None:
    keyword = pytest.importorskip("flashtext").KeywordProcessor()
    keyword.add_keywords_from_list(list(phrases))
    texts, words = _part(said, 100_000)
    rates["flashtext"] = words_a_second(
        words, lambda: [keyword.extract_keywords(text, span_info=True) for text in texts]
    )
    hits["flashtext"] = sum(len(keyword.extract_keywords(text)) for text in texts) / words


def _pyahocorasick(
    said: Said, phrases: list[str], rates: dict[str, float], hits: dict[str, float]
) -> None:
    automaton = pytest.importorskip("ahocorasick").Automaton()
    for phrase in phrases:
        automaton.add_word(f" {phrase} ", len(phrase))
    automaton.make_automaton()

    def work() -> int:
        count = 0
        for text in said.plain:
            ends = np.array(list(automaton.iter(text)), np.int64).reshape(-1, 2)
            count += len(leftmost_longest(ends[:, 0] - ends[:, 1], ends[:, 0]))
        return count

    rates["pyahocorasick + resolve"] = words_a_second(said.words, work)
    hits["pyahocorasick + resolve"] = work() / said.words


def _duckdb(said: Said, phrases: list[str], rates: dict[str, float]) -> None:
    import duckdb

    texts, words = _part(said, 20_000)
    pattern = r"\b(?:" + "|".join(phrases) + r")\b"
    with duckdb.connect() as con:
        con.execute("SET threads = 1")
        con.register("said", pa.table({"text": texts}))
        try:
            rates["DuckDB regexp"] = words_a_second(
                words,
                lambda: con.execute(
                    f"SELECT sum(len(regexp_extract_all(text, '{pattern}'))) FROM said"
                ).fetchall(),
            )
        except duckdb.Error as error:
            print(f"DuckDB regexp: {str(error)[:100]}")


_CHILD = """
import json, sys, time
from pathlib import Path
from kb.core.context import Run
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.pairs.build import build
begin, cpu = time.perf_counter(), time.process_time()
settings, profile = load_settings(dotenv=False), load_profile("minecraft")
summary = build(Run(settings, profile, Path(sys.argv[1]), workers=1))
status = open("/proc/self/status")  # ru_maxrss would tell the parent's
peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
print(json.dumps({"seconds": time.perf_counter() - begin, "cpu": time.process_time() - cpu,
                  "peak_mb": peak / 1024, **summary}))
"""


def test_pairs_at_scale(tools, tmp_path: Path, make_rows) -> None:
    rows, lengths = tables(
        DIFFERENT, WORDS // VIDEOS, [keyword.name for keyword in tools.keywords.every], share=0.03
    )
    measured = []
    print(
        f"\nscale of the paper: {VIDEOS:,} videos, {WORDS:,} words; one worker,"
        " from Parquet to Parquet"
    )
    for share in SHARES:
        root = tmp_path / f"{share}"
        _write(root, rows, lengths, int(VIDEOS * share * _SCALE), make_rows)
        child = subprocess.run(
            [sys.executable, "-c", _CHILD, str(root)], capture_output=True, text=True, check=True
        )
        one = json.loads(child.stdout.splitlines()[-1])
        measured.append(one)
        print(
            f"  {share * _SCALE:6.2%}: {one['videos']:,} videos, {one['words'] / 1e6:.1f} M words,"
            f" {one['pairs']:,} pairs: {one['cpu']:.1f} s of CPU ({one['seconds']:.1f} s),"
            f" {one['words'] / one['cpu'] / 1e6:.2f} M words/s, peak {one['peak_mb']:.0f} MB"
        )
    last = measured[-1]
    print(
        "  extrapolated from the last line, not measured: 100% is"
        f" {last['cpu'] * WORDS / last['words'] / 60:.0f} minutes of one core, "
        f"about {last['pairs'] * WORDS / last['words'] / 1e6:.1f} M pairs before"
        " max_pairs_per_video"
    )
    assert (
        last["peak_mb"] < 2 * measured[0]["peak_mb"] + 100
    )  # ten times the data in about the same memory


def _write(root: Path, rows: pa.Table, lengths: pa.Table, videos: int, make_rows) -> None:
    """Files of 4,000 transcripts each: the different ones again and again under other ids."""
    size = 2 * DIFFERENT
    for number, first in enumerate(range(0, videos, size)):
        count = min(size, videos - first)
        ids = [f"{first + at:011d}" for at in range(count)]
        which = pa.array(np.arange(count) % DIFFERENT)
        with ShardWriter(
            root / f"clean/youtube/transcripts/part-{number:05d}.parquet",
            "youtube/transcripts",
            in_order=True,
        ) as file:
            file.write(rows.take(which).set_column(0, rows.schema.field(0), pa.array(ids)))
        made = make_rows(
            "youtube/videos",
            count,
            video_id=ids,
            duration_s=lengths["duration_s"].take(which).to_pylist(),
        )
        write_table(
            root / f"clean/youtube/videos/part-{number:05d}.parquet", made, "youtube/videos"
        )
