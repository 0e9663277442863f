"""What a profile's keywords find in texts of your own, line by line.

    python -m tests.bench.keyword_coverage --documentation
    python -m tests.bench.keyword_coverage --set streams=DIR --set prompts=FILE \\
        --controls talks=DIR [--names FILE] [--profile NAME|FILE]

A set is a file or a folder of files: .txt with a line for each thing that is said, .vtt or .srt. A
file counts as one video. `--controls`: texts about anything else, where every hit is a false one.
`--documentation`: Python's own reference, as `help()` shows it, is such a control. `--names`:
words, one a line, that name things of the domain; recall is of lines of at least five
words that hold one of them. Each set is measured twice: topic unknown, and topic known.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from pydoc_data.topics import topics
from typing import Any

import pyarrow as pa

from kb.core.config.profile import load_profile
from kb.core.config.profile.products import Pairs
from kb.core.installation import np
from kb.pairs.extract import PairCounts, Tools, make_tools, matches
from kb.pairs.keywords import load
from kb.pairs.matching import phrase
from kb.pairs.transcript_batch import Text
from kb.schema import table

_ENDINGS = (".txt", ".vtt", ".srt")
_NOT_SAID = re.compile(r"^(\d+|WEBVTT.*|NOTE.*|[A-Za-z]+:.*|.*\d\d:\d\d.* --> .*|)$")
_FEWEST = 5  # words of a line whose recall is measured


def main() -> None:
    """Print a line for each set and topic."""
    asked = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    asked.add_argument("--set", action="append", default=[], metavar="NAME=PATH")
    asked.add_argument("--controls", action="append", default=[], metavar="NAME=PATH")
    asked.add_argument("--documentation", action="store_true")
    asked.add_argument("--names", type=Path)
    asked.add_argument("--profile", default="minecraft")
    given = asked.parse_args()
    profile = load_profile(given.profile)
    tools = make_tools(profile.section(Pairs), profile.seed, load(profile))
    names = given.names.read_text(encoding="utf-8").splitlines() if given.names else []
    words = "|".join(re.escape(phrase(one)) for one in names if phrase(one))
    naming = re.compile(rf"(?<!\S)(?:{words})(?!\S)") if words else None
    print(f"{'set':24}{'topic':9}{'lines':>9}{'with hit':>10}{'per 1,000 words':>17}{'recall':>9}")
    sets = [(name, _spoken(path)) for name, path in _named(given.set)]
    sets += [(f"control {name}", _spoken(path)) for name, path in _named(given.controls)]
    if given.documentation:
        sets.append(("control documentation", documentation()))
    for name, spoken in sets:
        for known in (False, True):
            row = measured(tools, spoken, naming, known=known)
            topic = "known" if known else "unknown"
            print(
                f"{name:24}{topic:9}{row['lines']:9,}{row['covered']:10.1%}"
                f"{row['per_1000']:17.2f}"
                + (f"{row['recall']:9.1%}" if row["recall"] is not None else f"{'–':>9}")
            )


def _named(given: list[str]) -> list[tuple[str, Path]]:
    return [(name, Path(path)) for name, _, path in (one.partition("=") for one in given)]


def _spoken(path: Path) -> list[list[str]]:
    return [lines_of(file) for file in files_of(path)]


def documentation() -> list[list[str]]:
    """The lines of each topic of Python's reference."""
    return [
        [line for line in text.splitlines() if line.strip()] for _, text in sorted(topics.items())
    ]


def files_of(path: Path) -> list[Path]:
    """The files of a set, in order."""
    if path.is_file():
        return [path]
    return sorted(one for one in path.rglob("*") if one.suffix.lower() in _ENDINGS)


def lines_of(path: Path) -> list[str]:
    """What is said in a file, without times and marks of captions."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    if path.suffix.lower() != ".txt":
        lines = [re.sub(r"<[^>]*>", "", one) for one in lines if not _NOT_SAID.match(one.strip())]
    return [one for one in lines if one.strip()]


def measured(
    tools: Tools, spoken: list[list[str]], naming: re.Pattern[str] | None, *, known: bool
) -> dict[str, Any]:
    """Lines, the share with a hit, hits per 1,000 words, and recall of lines that name a thing."""
    lines = words = hits = covered = wanted = found = 0
    for said in spoken:
        cues = [{"start_s": float(n), "duration_s": 1.0, "text": one} for n, one in enumerate(said)]
        row = {"video_id": "v", "kind": "manual", "language": "en", "cues": cues}
        rows = pa.Table.from_pylist([row], table("youtube/transcripts").arrow())
        text = Text(rows, known=np.array([known]))
        made = matches(text, tools.keywords, PairCounts())
        hit = {int(cue) for cue in text.cue_of(made.start)}
        lines, words, hits = lines + len(said), words + text.word_count, hits + len(made.start)
        covered += len(hit)
        if naming is None:
            continue
        for number, one in enumerate(said):
            folded = phrase(one)
            if len(folded.split()) >= _FEWEST and naming.search(folded):
                wanted += 1
                found += number in hit
    return {
        "lines": lines,
        "covered": covered / max(lines, 1),
        "per_1000": 1000 * hits / max(words, 1),
        "recall": found / wanted if wanted else None,
    }


if __name__ == "__main__":
    main()
