"""Every transcript of clean/youtube → pairs/*.parquet.

Transcripts are worked on in stretches of a file; what a stretch gave is kept under `state/pairs/`
until all are done, so that a run that was stopped goes on. The stretches are merged into globally
sorted files, which therefore don't depend on how the work was cut, on workers or on the engine.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts import manifest
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import LimitReached
from kb.core.optional import np
from kb.core.profile.pairs import Pairs
from kb.core.verdict import Summary
from kb.pairs import keywords as lists
from kb.pairs import transcripts
from kb.pairs.extract import PairCounts, Tools, make_tools, pairs_of
from kb.store.atomic import replacing_folder, write_text
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.shards import ShardWriter, sorted_shards, write_table

_RULES = "3"  # raised when the same input gives other rows
_STRETCH = 4096  # transcripts: some seconds of work
_TOTALS = (
    "videos",
    "words",
    "matches",
    "ambiguous",
    "ambiguous_alone",
    "excluded",
    "outside",
    "pairs",
)


def build(run: Run) -> Summary:
    """Make the pairs that are not made yet. The same input gives the same bytes.

    Raises ProfileError, MissingExtra, FatalError without transcripts, LimitReached, Interrupted.
    """
    section, keywords = run.profile.section(Pairs), check(run)
    plan = json.dumps(
        {
            "section": section.model_dump(mode="json"),
            "seed": run.seed,
            "keywords": lists.plain(keywords),
        },
        sort_keys=True,
    )
    with writer(run.root, "pairs"):
        mark = transcripts.fingerprint(run.root, _RULES, plan)
        known = read_summary(run.root)
        if known.get("fingerprint") == mark and known.get("complete") and not run.again:
            _all_there(run.root)
            # What a run had not cleared when it was killed behind its last rename.
            for left in Layout(run.root).pairing.glob("*"):
                shutil.rmtree(left, ignore_errors=True)
            run.progress.say("pairs are up to date")
            return _summary(known, run.root)
        work = Layout(run.root).pairing / mark
        if run.again:
            shutil.rmtree(work, ignore_errors=True)
        for other in Layout(run.root).pairing.glob("*"):  # of other transcripts or rules
            if other != work:
                shutil.rmtree(other, ignore_errors=True)
        write_text(work / "plan.json", plan)
        done = _work(run, work)
        counts = _finish(run, work, keywords, mark, done)
        if done:
            shutil.rmtree(work)
    summary = _summary(counts, run.root)
    if not done:
        error = LimitReached(f"--limit {run.limit} transcripts are done")
        error.summary = summary
        raise error
    return summary


def check(run: Run) -> lists.Keywords:
    """The profile's keywords, when everything else that pairs need is there.

    Raises ProfileError, MissingExtra, FatalError without transcripts.
    """
    section, keywords = run.profile.section(Pairs), lists.load(run.profile)
    make_tools(section, run.seed, keywords)
    transcripts.parts(run.root)
    return keywords


def clear_finished(root: Path) -> None:
    """Remove what a run had not cleared when it was killed behind its last rename. Under the lock.

    Parts of pairs that are not finished stay: the next run goes on with them.
    """
    known = read_summary(root)
    for left in Layout(root).pairing.glob("*"):
        if known.get("complete") and left.name == known.get("fingerprint"):
            shutil.rmtree(left, ignore_errors=True)


def read_summary(root: Path) -> dict[str, Any]:
    """What the last run left beside the pairs; empty when there was none."""
    try:
        return dict(json.loads((Layout(root).pairs / manifest.SUMMARY).read_text()))
    except (OSError, ValueError):
        return {}


def _all_there(root: Path) -> None:
    """Raises DamagedData where pairs that were made have lost a file."""
    manifest.check_complete(root, "pairs")


class Stretch(NamedTuple):
    """Rows `first` up to `after` of a file of transcripts."""

    path: Path
    first: int
    after: int

    @property
    def name(self) -> str:
        return f"{self.path.stem}.{self.first:09d}-{self.after:09d}"


def _work(run: Run, work: Path) -> bool:
    """Do what is left, up to the limit; whether all is done."""
    todo, everything = _todo(run, work)
    size = sum(path.stat().st_size for path in {one.path for one in todo})
    pairs = words = 0
    with (
        run.progress.task(
            "pairs", total=sum(one.after - one.first for one in todo), unit="transcripts"
        ) as task,
        make_executor(run.engine, run.processes(size), run.scheduler) as executor,
    ):
        arguments = ((str(work), str(one.path), one.first, one.after, one.name) for one in todo)
        for videos, more_words, more in map_in_order(
            executor, do_stretch, arguments, window=2 * run.workers
        ):
            pairs, words = pairs + more, words + more_words
            task.advance(videos, words=words, pairs=pairs)
    return everything


def _todo(run: Run, work: Path) -> tuple[list[Stretch], bool]:
    """Stretches that are not done, no more than the limit, and whether they are all."""
    done: dict[str, int] = {}
    for path in parquet_files(work):
        stem, _, span = path.stem.rpartition(".")
        done[stem] = max(done.get(stem, 0), int(span.partition("-")[2]))
    left = run.limit
    todo: list[Stretch] = []
    for path in transcripts.parts(run.root):
        first, total = done.get(path.stem, 0), transcripts.rows(path)
        while first < total:
            if left == 0:
                return todo, False
            after = min(first + _STRETCH, total, *([first + left] if left is not None else []))
            todo.append(Stretch(path, first, after))
            left = left - (after - first) if left is not None else None
            first = after
    return todo, True


def do_stretch(work: str, path: str, first: int, after: int, name: str) -> tuple[int, int, int]:
    """One task: make the pairs of a stretch; how many transcripts, words and pairs.

    Counts are written before rows.
    """
    tools, counts, tables = _tools(f"{work}/plan.json"), PairCounts(), []
    for text in transcripts.texts(Path(path), first, after):
        rows, more = pairs_of(text, tools)
        counts.add(more)
        tables.append(rows)
    write_text(
        Path(work, f"{name}.json"),
        json.dumps(
            {
                "totals": counts.totals,
                "hits": {what: hits.tolist() for what, hits in counts.hits.items()},
            }
        ),
    )
    out = Path(work, f"{name}.parquet")
    if tables:
        write_table(out, pa.concat_tables(tables), "pairs/pairs")
    else:
        with ShardWriter(out, "pairs/pairs", in_order=True):
            pass
    return counts.totals["videos"], counts.totals["words"], counts.totals["pairs"]


@lru_cache(maxsize=2)
def _tools(plan: str) -> Tools:
    """Automaton and tokenizer of a plan, made once in each worker."""
    data = json.loads(Path(plan).read_text())
    keywords = lists.of_plain(data["keywords"])
    return make_tools(Pairs(**data["section"]), data["seed"], keywords)


def _finish(
    run: Run, work: Path, keywords: lists.Keywords, mark: str, done: bool
) -> dict[str, Any]:
    """Merge what is done into pairs/, with the counts beside it."""
    counts = PairCounts()
    for path in parquet_files(work):
        data = json.loads(path.with_suffix(".json").read_text())
        counts.add(
            PairCounts(
                Counter(data["totals"]),
                {what: np.asarray(hits) for what, hits in data["hits"].items()},
            )
        )
    known: dict[str, Any] = {"fingerprint": mark, "complete": done}
    known |= {name: counts.totals[name] for name in _TOTALS}
    found = [(keyword.name, counts.of(number)) for number, keyword in enumerate(keywords.every)]
    known["keywords"] = dict(
        sorted(
            ((name, hits) for name, hits in found if hits),
            key=lambda item: (-item[1]["matches"], item[0]),
        )
    )
    with replacing_folder(Layout(run.root).pairs) as fresh:
        sorted_shards(
            parquet_files(work),
            fresh,
            "pairs/pairs",
            rows_per_shard=run.profile.release.rows_per_shard,
            released=False,
        )
        write_text(fresh / manifest.SUMMARY, json.dumps(known, indent=1, ensure_ascii=False) + "\n")
    return known


def _summary(known: dict[str, Any], root: Path) -> Summary:
    return Summary(
        {"command": "pairs", "source": "pairs"},
        **{name: known[name] for name in _TOTALS},
        keywords_found=len(known["keywords"]),
        path=str(Layout(root).pairs),
    )
