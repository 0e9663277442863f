"""Kept transcripts → keywords that are said, with a text of about 16 to 77 CLIP tokens around them.

    python pairs.py TRANSCRIPTS PHRASES OUT PROCESSES

PHRASES has lines of phrase, keyword ("" for an excluded phrase) and the words within which another
keyword must stand ("" where none need be), separated by tabs.
"""

import re
import sys
from bisect import bisect_right
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from random import Random

import pyarrow as pa
import pyarrow.parquet as pq
from ahocorasick_rs import AhoCorasick

from kb.pairs.clip_tokens import Tokens

OTHER = re.compile(r"[\W_]+")
SOUND = re.compile(r"\[[^\[\]]{0,64}\]")
COLUMNS = ["video_id", "keyword", "text", "tokens", "start_s", "end_s", "clip_start", "clip_end"]
count = lru_cache(1_000_000)(Tokens().count)


def matches(text, automaton):
    """The leftmost, of these the longest matches, without overlaps: (phrase, first character)."""
    found = automaton.find_matches_as_indexes(text, overlapping=True)
    end = 0
    for which, start, after in sorted(found, key=lambda hit: (hit[1], -hit[2])):
        if start + 1 >= end:
            yield which, start + 1
            end = after - 1


def of_video(video_id, cues, automaton, phrases):
    words, times = [], []
    for cue in cues:
        said = OTHER.sub(" ", SOUND.sub(" ", cue["text"])).split()
        starts = cue["word_start_s"] or [
            cue["start_s"] + cue["duration_s"] * n / len(said) for n in range(len(said))
        ]
        words += said
        times += [starts[min(n, len(starts) - 1)] for n in range(len(said))]
    ends = list(accumulate(len(word) + 1 for word in words))
    hits = []
    for which, start in matches(f" {' '.join(words).lower()} ", automaton):
        hits.append((bisect_right(ends, start - 1), *phrases[which]))
    certain = [at for at, _, keyword, reach in hits if keyword and not reach]
    for at, phrase, keyword, reach in hits:
        if not keyword or (reach and not any(abs(at - one) <= int(reach) for one in certain)):
            continue
        chance = Random(f"{video_id} {at}")
        goal, first, after = chance.randint(16, 77), at, at + phrase.count(" ") + 1
        size = 2 + sum(map(count, words[first:after]))
        while size < goal and (first > 0 or after < len(words)):
            if after < len(words):
                size, after = size + count(words[after]), after + 1
            if first > 0 and size < goal:
                size, first = size + count(words[first - 1]), first - 1
        begin, end = times[at], times[min(after, len(times) - 1)]
        center, length = chance.uniform(begin, end), chance.uniform(8, 16)
        text = " ".join(words[first:after])
        clip = max(0, center - length / 2), center + length / 2
        yield video_id, keyword, text, size, begin, end, *clip


def of_file(path, listed, out):
    phrases = [line.split("\t") for line in Path(listed).read_text(encoding="utf-8").splitlines()]
    automaton = AhoCorasick([f" {phrase} " for phrase, _, _ in phrases])
    rows = []
    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(128, columns=["video_id", "cues"]):
            for row in batch.to_pylist():
                rows += of_video(row["video_id"], row["cues"], automaton, phrases)
    table = pa.table([[row[at] for row in rows] for at in range(len(COLUMNS))], names=COLUMNS)
    pq.write_table(table, Path(out, Path(path).name), compression="zstd")
    return len(rows)


if __name__ == "__main__":
    folder, listed, out, processes = sys.argv[1:5]
    with ProcessPoolExecutor(int(processes)) as pool:
        jobs = [pool.submit(of_file, path, listed, out) for path in Path(folder).glob("*.parquet")]
        print(sum(job.result() for job in jobs), "pairs")
