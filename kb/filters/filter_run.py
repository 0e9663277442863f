"""`kb <source> filter`: raw answers → clean/<source>/, every record kept, rejected, failed or
pending.

    decode   a task per raw segment: rows partitioned into buckets
    texts    a task per bucket: texts that reach the toxicity stage, scored if they have no score
    judge    a task per bucket: newest rows joined, judged by stages in order, written

The steps of a task are in kb.filters.tasks. Workers get paths and names only, and load the pipeline
by its path. clean/<source> is replaced in one step after the counts were checked.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.artifacts import domain_binding, index, manifest
from kb.core.config import pipeline
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import CountMismatch, DamagedData, FatalError
from kb.core.summary import Summary, Tally, vocabulary
from kb.filters.chain import VERDICTS, Clean
from kb.filters.tasks import FilterJob, collect_texts, decode_segment, filter_bucket, spec_of
from kb.filters.unanswered_keys import unanswered
from kb.schema.tables import table
from kb.store.atomic import write_text
from kb.store.layout import Layout
from kb.store.lock import of_clean, writer
from kb.store.rawlog import damaged_answers, rawlog
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.store.tables import partition, row_counts
from kb.store.tables.shard_writer import write_table


def run_clean(run: Run, source: str) -> Summary:
    """Filter a source's raw answers. Returns the tally, counts by stage, and anomalies.

    Raises FatalError without raw data, CountMismatch, WriterLocked, DiskFull, and what the scorer
    raises without its model.
    """
    run.profile.section(source)
    job = _job(run, source)
    spec = spec_of(job)
    key = spec.scorer.check(run, source) if spec.scorer is not None else ""
    _segments(run.root, spec)  # without any, nothing is written
    with domain_binding.writing(run, *of_clean(source)), _work(job) as work:
        segments = _segments(run.root, spec)
        raw = manifest.inputs(run.root, f"clean/{source}")
        tombstones.heal(run.root, source)
        damaged_answers.check(run.root, source)
        size = _size(run.root, spec, segments)
        job = job._replace(work=str(work), buckets=partition.how_many(size), scores=key)
        with make_executor(run.engine, run.processes(size), run.scheduler) as executor:
            try:
                decoded = _decode(run, job, segments, executor)
            except DamagedData as error:
                _suspect(run, source, error)
                raise
            if key and spec.scorer is not None:
                spec.scorer.annotate(run, source, _texts(run, job, executor, keep=True))
            with manifest.replacing(run.root, f"clean/{source}", inputs=raw) as build:
                fresh = build.folder
                job = job._replace(out=str(fresh))
                counts = _judge(run, job, executor)
                summary = _summary(spec, fresh, decoded, counts, key)
                summary |= spec.about(run.root) if spec.about is not None else {}
                summary |= spec.figures(fresh) if spec.figures is not None else {}
                write_text(fresh / "summary.json", json.dumps(summary, indent=1) + "\n")
        index.remove_stale(run.root, source)
    return summary


def texts(run: Run, source: str) -> Iterator[pa.Array[Any]]:
    """The texts that the toxicity stage of a source would look at, for `kb annotate`."""
    job = _job(run, source)
    spec = spec_of(job)
    _segments(run.root, spec)
    with writer(run.root, source), _work(job) as work:
        segments = _segments(run.root, spec)
        size = _size(run.root, spec, segments)
        job = job._replace(work=str(work), buckets=partition.how_many(size))
        with make_executor(run.engine, run.processes(size), run.scheduler) as executor:
            try:
                _decode(run, job, segments, executor)
            except DamagedData as error:
                _suspect(run, source, error)
                raise
            yield from _texts(run, job, executor, keep=False)


def _job(run: Run, source: str) -> FilterJob:
    path = str(pipeline.locate(source, run.pipeline))
    stamp = tombstones.version(run.root, source)
    return FilterJob(
        path,
        run.profile.model_dump_json(),
        str(run.profile.path),
        source,
        str(run.root.absolute()),
        "",
        "",
        1,
        "",
        stamp,
    )


class _work:
    """A temporary folder for partitioned rows."""

    def __init__(self, job: FilterJob) -> None:
        self.path = Layout(Path(job.root)).filtering(job.source)

    def __enter__(self) -> Path:
        shutil.rmtree(self.path, ignore_errors=True)
        self.path.mkdir(parents=True)
        return self.path

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)


def _segments(root: Path, spec: Clean) -> list[tuple[str, Path]]:
    segments = [
        (kind, path) for kind in spec.kinds for path in rawlog.segments(root, spec.source, kind)
    ]
    if not any(spec.kinds[kind].bucket for kind, _ in segments):
        raise FatalError(
            f"nothing to filter: {Layout(root).raw(spec.source)} is empty",
            hint=f"run `kb {spec.source} crawl` first",
        )
    return segments


def _size(root: Path, spec: Clean, segments: list[tuple[str, Path]]) -> int:
    """Bytes to be read."""
    size = sum(path.stat().st_size for _, path in segments)
    return size + (spec.side_files.size(root) if spec.side_files is not None else 0)


def _decode(
    run: Run, job: FilterJob, segments: list[tuple[str, Path]], executor: Any
) -> Counter[str]:
    """Counts of rows, and of unknown keys as "?<path>"."""
    total: Counter[str] = Counter()
    tasks = ((job, kind, str(path), place) for place, (kind, path) in enumerate(segments))
    damaged: list[tuple[int, int]] = []  # segment, and the first byte that can't be read
    with run.progress.task(f"decode {job.source}", total=len(segments), unit="raw files") as task:
        for number, done in enumerate(
            map_in_order(executor, decode_segment, tasks, window=2 * run.workers)
        ):
            total["rows"] += done["rows"]
            total.update({f"?{path}": count for path, count in done["unknown"].items()})
            if done["damaged"] is not None:
                damaged.append((number, done["damaged"]))
            task.advance(1, rows=total["rows"])
    if damaged:
        raise _damaged(job, [(*segments[number], at) for number, at in damaged])
    return total


def _damaged(job: FilterJob, files: list[tuple[str, Path, int]]) -> DamagedData:
    _, path, at = files[0]
    more = f" (and {len(files) - 1:,} more files)" if len(files) > 1 else ""
    error = DamagedData(f"{path} is damaged at byte {at:,}{more}")
    error.paths = [path for _, path, _ in files]  # type: ignore[attr-defined]
    error.summary = Summary(source=job.source, truncated_files=len(files))
    return error


def _suspect(run: Run, source: str, error: DamagedData) -> None:
    """Note damaged segments for the crawl, which is what to run."""
    frontier = Frontier(Layout(run.root).state(source))
    try:
        damaged_answers.note(
            run.root,
            source,
            frontier,
            error,
            f"run `kb {source} crawl`: it moves damaged data away and fetches it again",
        )
    finally:
        frontier.close()


def _texts(run: Run, job: FilterJob, executor: Any, *, keep: bool) -> Iterator[pa.Array[Any]]:
    tasks = ((job, number, keep) for number in range(job.buckets))
    for path in map_in_order(executor, collect_texts, tasks, window=2 * run.workers):
        with pa.ipc.open_file(path) as file:
            for number in range(file.num_record_batches):
                yield file.get_batch(number).column(0)
        Path(path).unlink()


def _judge(run: Run, job: FilterJob, executor: Any) -> Counter[str]:
    total: Counter[str] = Counter()
    spec = spec_of(job)
    tasks = ((job, number) for number in range(job.buckets))
    with run.progress.task(f"filter {job.source}", total=job.buckets, unit="parts") as task:
        for done in map_in_order(executor, filter_bucket, tasks, window=2 * run.workers):
            total.update(done)
            task.advance(1, kept=total["kept"], rejected=total["rejected"])
    if spec.unanswered is not None:
        total.update(unanswered(job, spec))
    _write_empty(Path(job.out), spec)
    for cut in Path(job.out).rglob(
        ".*.tmp"
    ):  # of a worker that died; its task was done again by another
        cut.unlink()
    return total


def _write_empty(out: Path, spec: Clean) -> None:
    """A first part for each table that has none, so that readers find every table."""
    tables = (
        [chain.table for chain in spec.chains]
        + [follow.table for follow in spec.follow]
        + [f"shared/{verdict}" for verdict in VERDICTS]
    )
    for name in tables:
        declared = table(name)
        path = out / declared.short / "part-00000.parquet"
        if not path.exists():
            write_table(path, declared.arrow().empty_table(), declared, sync=False)


def _summary(
    spec: Clean, folder: Path, decoded: Counter[str], counts: Counter[str], key: str
) -> Summary:
    """The numbers of the written files, by table. Raises CountMismatch when the workers' differ."""
    tables = {table(chain.table).short: chain.prefix for chain in spec.chains}
    tallies = row_counts.tally(folder, tables)
    names = ("crawled", "kept", "rejected", "failed", "pending")
    total = Tally(*(sum(each[name] for each in tallies.values()) for name in names))
    if total.check(spec.source) != Tally(*(counts[name] for name in names)):
        raise CountMismatch(
            f"{spec.source}: the files contain {asdict(total)},"
            f" but the workers counted {dict(counts)}",
            hint="this is a bug in Lorecrawl; no output was replaced",
        )
    summary = Summary(
        command=f"{spec.source} filter",
        source=spec.source,
        counted=" and ".join(tables),
        **asdict(total),
        missing=sum(each["missing"] for each in tallies.values()),
        tally=tallies,
    )
    summary["duplicates"] = counts["duplicates"]
    summary["truncated_files"] = 0  # with any there is no summary of a filter: DamagedData has it
    summary["stages"] = {
        name.removeprefix("stage "): count
        for name, count in sorted(counts.items())
        if name.startswith("stage ")
    }
    kept = {name.removeprefix("kept "): n for name, n in counts.items() if name.startswith("kept ")}
    summary["tables"] = {
        name: kept[name]
        for name in sorted(kept, key=lambda name: vocabulary.place(table(name).short))
    }
    summary["unknown_keys"] = {
        path[1:]: count for path, count in sorted(decoded.items()) if path.startswith("?")
    }
    if key:  # of the models whose scores are there, the one whose scores decided; releases name it
        summary["model"], _, summary["revision"] = key.rpartition("@")
    else:
        summary["toxicity"] = "not scored"
    return summary
