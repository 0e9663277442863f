"""Links: words a second beside the matcher alone and the pairs, and memory as files grow in number.

    KB_BENCH_SCALE=0.1 make bench ARGS="-k links"    fewer transcripts, for a quick look

CPU seconds of one core, so that other work on the machine disturbs the ratios little. Transcripts
are invented (tests/pairs/made.py); short texts are the same words, twenty at a time.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from kb.core.config.profile import load_profile
from kb.links.build import mentions
from kb.links.texts import TextPart, in_pieces
from kb.pairs.extract import make_tools, pairs_of
from kb.pairs.keywords import load
from kb.pairs.transcript_batch import Text
from kb.schema import table
from kb.store.tables.shard_writer import write_table
from tests.bench.measured import words_a_second
from tests.pairs.made import tables

pytestmark = pytest.mark.bench

_SCALE = float(os.environ.get("KB_BENCH_SCALE", "1"))
_VIDEOS = max(20, round(330 * _SCALE))
_SHORT = 20  # words of a comment


@pytest.fixture(scope="module")
def tools():
    profile = load_profile("minecraft")
    return make_tools(profile.section("pairs"), profile.seed, load(profile))


@pytest.fixture(scope="module")
def said(tools) -> tuple[pa.Table, pa.Array]:
    rows, lengths = tables(_VIDEOS, 3000, [keyword.name for keyword in tools.keywords.every])
    return rows, lengths["duration_s"].combine_chunks()


def test_links_are_made_at_the_speed_of_the_matcher(said, tools) -> None:
    rows, lengths = said
    keywords, text = tools.keywords, Text(rows)
    words = text.word_count
    spoken = text.raw.decode("latin-1").split()
    short = [" ".join(spoken[at : at + _SHORT]) for at in range(0, len(spoken), _SHORT)]
    keys = pa.array([f"t1_{number:07x}" for number in range(len(short))])
    texts = pa.array(short)

    def comments() -> Iterator[TextPart]:
        return in_pieces("comment", keys, np.arange(len(short)), texts)

    rates = {
        "fold + match + resolve": words_a_second(words, lambda: keywords.matcher.find(text.raw)),
        "kb pairs": words_a_second(words, lambda: pairs_of(Text(rows, lengths), tools)),
        "kb links, transcripts": words_a_second(
            words,
            lambda: mentions(
                "youtube", TextPart("transcript", Text(rows, lengths), timed=True), keywords
            ),
        ),
        f"kb links, texts of {_SHORT} words": words_a_second(
            words, lambda: [mentions("reddit", part, keywords) for part in comments()]
        ),
    }
    print(f"\n{len(tools.keywords.phrases):,} phrases, {words:,} words")
    for name, rate in rates.items():
        print(f"  {name:30} {rate / 1e6:7.2f} M words/s  {rate / rates['kb pairs']:5.2f} × pairs")
    assert rates["kb links, transcripts"] >= rates["kb pairs"]
    assert rates[f"kb links, texts of {_SHORT} words"] >= 0.5 * rates["kb pairs"]


_BUILD = """
import sys
from pathlib import Path
from kb.core.context import Run
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.links.build import build
from kb.registry import SOURCES
run = Run(load_settings(dotenv=False), load_profile("minecraft"), Path(sys.argv[1]), workers=1)
links = build(run, SOURCES, dict)["links"]
status = open("/proc/self/status")  # ru_maxrss would tell the parent's
print(links, next(int(line.split()[1]) for line in status if line.startswith("VmHWM")))
"""


def test_memory_is_that_of_a_file_however_many_there_are(said, tmp_path: Path) -> None:
    rows, _ = said
    peaks, links = [], []
    for files in (2, 8):
        root = tmp_path / str(files)
        for number in range(files):
            ids = pa.array([f"f{number:02d}{video:08d}" for video in range(rows.num_rows)])
            part = rows.set_column(0, rows.schema.field(0), ids)
            name = f"part-{number:05d}.parquet"
            write_table(root / "clean/youtube/transcripts" / name, part, "youtube/transcripts")
        empty = table("youtube/videos").arrow().empty_table()
        write_table(root / "clean/youtube/videos/part-00000.parquet", empty, "youtube/videos")
        done = subprocess.run(
            [sys.executable, "-c", _BUILD, str(root)], capture_output=True, text=True, check=True
        )
        made, peak = done.stdout.split()
        links.append(int(made))
        peaks.append(int(peak) / 1024)
    for files, count, peak in zip((2, 8), links, peaks, strict=True):
        print(f"  {files} files of transcripts: {count:,} links, peak {peak:.0f} MB")
    assert links[1] == 4 * links[0]
    assert peaks[1] <= 1.25 * peaks[0]
