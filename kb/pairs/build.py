"""Every transcript of clean/youtube → pairs/pairs-*.parquet.

A part is some thousand transcripts of a file. The parts are merged into globally sorted files, so
that these do not depend on how the work was cut, on workers or on the engine.
"""

import json
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import Any

from kb.artifacts import manifest, measures
from kb.artifacts.parted_build import (
    Part,
    PartedBuild,
    is_current,
    parted_build,
    read_plan,
    write_part,
)
from kb.core.config.profile.products import Pairs
from kb.core.context import Run
from kb.core.installation import np
from kb.core.summary import Summary
from kb.core.summary.phrases import count
from kb.pairs import keywords as lists
from kb.pairs import quality, transcripts
from kb.pairs.extract import PairCounts, Tools, make_tools, pairs_of
from kb.pairs.quality import FASTEST_SPEECH
from kb.store.layout import Layout
from kb.store.lock import writer
from kb.store.tables.shard_writer import sorted_shards

_ROWS = 4096  # transcripts of a part: some seconds of work
_TOTALS = (
    "videos",
    "words",
    "matches",
    "ambiguous",
    "ambiguous_alone",
    "excluded",
    "outside",
    "pairs",
    "fast_videos",
)


def build(run: Run) -> Summary:
    """Make the pairs that are not made yet. The same input gives the same bytes.

    Raises ProfileError, MissingExtra, FatalError without transcripts, Interrupted.
    """
    section, keywords = run.profile.section(Pairs), required_keywords(run)
    plan = {
        "section": section.model_dump(mode="json"),
        "seed": run.seed,
        "keywords": lists.plain(keywords),
        "language": run.profile.language,
    }
    with writer(run.root, "pairs"):
        if is_current(run, "pairs"):
            run.progress.say("pairs are up to date")
            return _summary(run.root)
        inputs = manifest.inputs(run.root, "pairs")
        with parted_build(run, "pairs", inputs, plan) as parted:
            parts = _parts(run.root)
            parted.make_parts(
                parts, make_part, "transcripts", {Path(p.arguments[0]) for p in parts}
            )
            sorted_shards(parted.rows, parted.build.folder, "pairs/pairs", released=False)
            quality.finish(parted.rows, parted.build.folder)
            _write_measures(run, parted.build)
            parted.build.figures = _figures(parted, keywords)
            if fast := parted.build.figures["fast_videos"]:
                run.progress.say(
                    f"{count(fast, '{n} videos')} with more than {FASTEST_SPEECH} words a second"
                    " over the whole length, which nobody speaks: their captions are doubled or no"
                    f" speech; `kb pairs draw --where 'video_words_per_second <= {FASTEST_SPEECH}'`"
                    " leaves them out"
                )
    return _summary(run.root)


def _write_measures(run: Run, fresh: manifest.Build) -> None:
    """Figures of all pairs, and those of samples until they are derived again."""
    there = manifest.read_manifest(run.root, "pairs") is not None
    kept = measures.read_measures(Layout(run.root).pairs) if there else {}
    measures.count_pairs(run.root, fresh.folder, kept)


def required_keywords(run: Run) -> lists.Keywords:
    """The profile's keywords, when the extra that pairs need is installed.

    Raises ProfileError, MissingExtra.
    """
    section, keywords = run.profile.section(Pairs), lists.load(run.profile)
    make_tools(section, run.seed, keywords)
    return keywords


def _parts(root: Path) -> list[Part]:
    """A part is `<file>.<first row>-<row after the last>`."""
    parts: list[Part] = []
    for path in transcripts.parts(root):
        total = transcripts.rows(path)
        for first in range(0, total, _ROWS):
            after = min(first + _ROWS, total)
            name = f"{path.stem}.{first:09d}-{after:09d}"
            parts.append(Part(name, (str(path), first, after), after - first))
    return parts


def make_part(folder: str, name: str, path: str, first: int, after: int) -> dict[str, int]:
    """The pairs of some transcripts of a file."""
    tools, language = _tools(read_plan(folder))
    counts, rows, figures = PairCounts(), [], []
    for text in transcripts.texts(Path(path), first, after):
        batch = pairs_of(text, tools)
        counts.add(batch.counts)
        counts.totals["fast_videos"] += int((text.words_per_second > FASTEST_SPEECH).sum())
        rows.append(batch.rows)
        figures.append(quality.of_batch(text, batch, language))
    quality.write_part(folder, name, figures)
    hits = {what: numbers.tolist() for what, numbers in counts.hits.items()}
    write_part(folder, name, rows, "pairs/pairs", {"totals": counts.totals, "hits": hits})
    return {"words": counts.totals["words"], "pairs": counts.totals["pairs"]}


@lru_cache(maxsize=2)
def _tools(encoded: str) -> tuple[Tools, str]:
    """Automaton and tokenizer of a plan, made once in each worker, and the language."""
    plan = json.loads(encoded)
    keywords = lists.of_plain(plan["keywords"])
    return make_tools(Pairs(**plan["section"]), plan["seed"], keywords), plan["language"]


def _figures(parted: PartedBuild, keywords: lists.Keywords) -> dict[str, Any]:
    """The totals of all parts, and the hits of each keyword, most first."""
    counts = PairCounts()
    for part in parted.figures():
        hits = {what: np.asarray(numbers) for what, numbers in part["hits"].items()}
        counts.add(PairCounts(Counter(part["totals"]), hits))
    every = [(keyword.name, counts.of(number)) for number, keyword in enumerate(keywords.every)]
    with_hits = [(name, hits) for name, hits in every if hits]
    with_hits.sort(key=lambda item: (-item[1]["matches"], item[0]))
    return {name: counts.totals[name] for name in _TOTALS} | {"keywords": dict(with_hits)}


def _summary(root: Path) -> Summary:
    made = manifest.read_manifest(root, "pairs")
    figures = made.figures if made is not None else {}
    return Summary(
        {"command": "pairs", "source": "pairs"},
        **{name: figures[name] for name in _TOTALS},
        keywords_in_pairs=sum("pairs" in hits for hits in figures["keywords"].values()),
        keywords_found=len(figures["keywords"]),
        path=str(Layout(root).pairs),
    )
