"""`kb <source> filter`: raw answers → clean/<source>/, every record kept, rejected, failed or
pending.

    decode   a task per raw segment: rows partitioned into buckets
    texts    a task per bucket: texts that reach the toxicity stage, scored if they have no score
    judge    a task per bucket: newest rows joined, judged by stages in order, written

The steps of a task are in kb.filters.tasks. Workers get paths and names only, and of a
user's own recipe its text. clean/<source> is replaced in one step after the counts were checked.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import domain_binding, freshness, index, manifest
from kb.core.config.pipeline import Recipe, recipe_of
from kb.core.context import Run
from kb.core.engine import Workers, executor_of, map_in_order
from kb.core.errors import CountMismatch, DamagedData, FatalError, NothingKept
from kb.core.summary import Summary, Tally, vocabulary
from kb.filters.chain import Clean, GivenUp
from kb.filters.tasks import (
    FilterJob,
    collect_texts,
    decode_segment,
    filter_bucket,
    purged_keys,
    spec_of,
)
from kb.schema.tables import table
from kb.store.atomic import write_text
from kb.store.layout import VERDICTS, Layout, parquet_files
from kb.store.lock import of_clean, writer
from kb.store.rawlog import quarantine, rawlog
from kb.store.state import tombstones
from kb.store.tables import parquet, partition, row_counts
from kb.store.tables.shard_writer import write_table

_WHY = {"rejected": ("stage", "reason"), "failed": ("reason",)}  # columns that explain a verdict


def run_clean(run: Run, source: str, *, restored: bool = False) -> Summary:
    """Filter a source's raw answers; of those that are `restored` every row that is there passes.
    Returns the tally, counts by stage, and anomalies.

    Raises FatalError without raw data, CountMismatch, WriterLocked, DiskFull, and what the scorer
    raises without its model.
    """
    run.profile.section(source)
    job = _job(run, source, restored=restored)
    spec = spec_of(job)
    key = spec.scorer.model_key(run, source) if spec.scorer is not None else ""
    _require_answers(run.root, spec)
    with domain_binding.writing(run, *of_clean(source)):
        raw = manifest.inputs(run.root, f"clean/{source}")
        quarantine.refuse_lost_answers(run.root, source)
        with _decoded(run, job._replace(scores=key)) as decoded:
            if key and spec.scorer is not None:
                spec.scorer.annotate(run, source, _texts(run, decoded))
            settings = freshness.settings(run, f"clean/{source}")
            if key:
                settings[freshness.MODEL] = key
            with manifest.replacing(
                run.root, f"clean/{source}", inputs=raw, settings=settings
            ) as build:
                fresh, counts = build.folder, Counter[str]()
                job = decoded.job._replace(out=str(fresh))
                with run.progress.task(f"filter {source}", total=job.buckets, unit="parts") as task:
                    for done in map_in_order(
                        decoded.executor, filter_bucket, decoded.tasks(job), decoded.executor.window
                    ):
                        counts.update(done)
                        task.advance(1, kept=counts["kept"], rejected=counts["rejected"])
                _check_rows(spec, decoded, counts)
                counts.update(_add_what_no_bucket_has(job, spec))
                changed = spec.across(run.root, fresh) if spec.across is not None else {}
                for name, rows in changed.items():
                    counts[f"kept {name}"] += rows
                summary = _summary(spec, fresh, decoded.unknown, counts, key)
                summary |= spec.figures(run.root, fresh) if spec.figures is not None else {}
                write_text(fresh / "summary.json", json.dumps(summary, indent=1) + "\n")
        index.remove_stale(run.root, source)
    return summary


def check_scorer(run: Run, source: str) -> None:
    """Raises UsageError where the texts of a source can't be scored."""
    if (scorer := spec_of(_job(run, source)).scorer) is not None:
        scorer.model_key(run, source)


def texts(run: Run, source: str) -> Iterator[pa.Array[Any]]:
    """The texts that the toxicity stage of a source would look at, for `kb annotate`."""
    job = _job(run, source)
    _require_answers(run.root, spec_of(job))
    with writer(run.root, source), _decoded(run, job) as decoded:
        yield from _texts(run, decoded)


def check_kept(run: Run, source: str, summary: Summary) -> Summary:
    """The summary. Raises NothingKept, which has it, when every row failed or was rejected.

    Rows that wait for the crawl may still be kept.
    """
    if summary["kept"] or summary["pending"] or not summary["crawled"]:
        return summary
    counts: Counter[tuple[str, str]] = Counter()
    for verdict, columns in _WHY.items():
        for path in parquet_files(Layout(run.root).clean(source) / verdict):
            rows = parquet.read_table(path, columns=list(columns))
            reasons = [rows[name].cast(pa.string()) for name in columns]
            for entry in pc.value_counts(pc.binary_join_element_wise(*reasons, ": ")).to_pylist():
                counts[verdict, str(entry["values"])] += entry["counts"]
    (((verdict, why), n),) = counts.most_common(1)
    error = NothingKept(
        f"nothing was kept of {summary['crawled']:,} {summary['counted']}; the most frequent"
        f" reason is {why} ({n:,} {verdict})",
        hint=f"see `kb query 'SELECT * FROM clean.{source}_{verdict}'` and the rules of"
        f" [{source}] in {run.profile.path}"
        if verdict == "rejected"
        else f"run `kb {source} crawl`, which retries what failed",
    )
    error.summary = summary
    raise error


def _job(run: Run, source: str, *, restored: bool = False) -> FilterJob:
    return FilterJob(
        recipe=Recipe(source) if restored else recipe_of(run.profile, source),
        restored=restored,
        profile=run.profile.model_dump_json(),
        profile_path=str(run.profile.path),
        source=source,
        root=str(run.root.absolute()),
        tombstones=tombstones.version(run.root, source),
    )


class _Decoded(NamedTuple):
    """Raw answers as partitioned rows: how many of which kind are in which bucket; unknown keys."""

    job: FilterJob
    executor: Workers
    rows: dict[str, Counter[int]]
    unknown: Counter[str]

    def tasks(self, job: FilterJob) -> Iterator[tuple[FilterJob, int, dict[str, int]]]:
        """A task for each bucket, with the rows of each kind that it should find there."""
        in_all = {kind: rows[0] for kind, rows in self.rows.items() if not self.bucketed(kind)}
        for number in range(job.buckets):
            own = {kind: rows[number] for kind, rows in self.rows.items() if self.bucketed(kind)}
            yield job, number, {**own, **in_all}

    def bucketed(self, kind: str) -> bool:
        """Whether its rows are spread; others are read by every bucket."""
        return bool(spec_of(self.job).raw.kinds[kind].bucket)


@contextmanager
def _decoded(run: Run, job: FilterJob) -> Iterator[_Decoded]:
    """Decode the raw answers into a temporary folder. Raises DamagedData."""
    spec = spec_of(job)
    segments = _require_answers(run.root, spec)
    size = sum(path.stat().st_size for _, path in segments)
    size += spec.raw.side_files.size(run.root) if spec.raw.side_files is not None else 0
    work = Layout(run.root).filtering(job.source)
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    job = job._replace(work=str(work), buckets=partition.how_many(size))
    try:
        with executor_of(run, size) as executor:
            yield _Decoded(job, executor, *_decode(run, job, segments, executor))
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _require_answers(root: Path, spec: Clean) -> list[tuple[str, Path]]:
    """The segments of raw answers, with the kind of each. Raises FatalError where there are none
    that rows can be made of, or their authors were hashed with different keys.
    """
    segments = [
        (kind, path) for kind in spec.raw.kinds for path in rawlog.segments(root, spec.source, kind)
    ]
    if not any(spec.raw.kinds[kind].bucket for kind, _ in segments):
        raise FatalError(
            f"nothing to filter: {Layout(root).raw(spec.source)} is empty",
            hint=f"run `kb {spec.source} crawl` first",
        )
    if len(marks := Layout(root).key_marks(spec.source)) > 1:
        raise FatalError(
            f"the authors in {marks[0].parent} were hashed with {len(marks)} keys:"
            f" {', '.join(path.name for path in marks)}",
            hint=f"collect again on all machines but one, with a copy of its"
            f" {Layout(root).key(spec.source)}",
        )
    return segments


def _decode(
    run: Run, job: FilterJob, segments: list[tuple[str, Path]], executor: Workers
) -> tuple[dict[str, Counter[int]], Counter[str]]:
    rows: dict[str, Counter[int]] = {kind: Counter() for kind, _ in segments}
    unknown: Counter[str] = Counter()
    # The largest first: a large one that begins last would keep one worker when others are done.
    ordered = sorted(enumerate(segments), key=lambda numbered: -numbered[1][1].stat().st_size)
    tasks = ((job, kind, str(path), place) for place, (kind, path) in ordered)
    damaged: list[tuple[Path, int]] = []  # segment, and the first byte that can't be read
    try:
        with run.progress.task(
            f"decode {job.source}", total=len(segments), unit="raw files"
        ) as task:
            decoding = map_in_order(executor, decode_segment, tasks, window=executor.window)
            for (_, (kind, path)), done in zip(ordered, decoding, strict=True):
                rows[kind].update(done["rows"])
                unknown.update(done["unknown"])
                if done["damaged"] is not None:
                    damaged.append((path, done["damaged"]))
                task.advance(1, rows=sum(counts.total() for counts in rows.values()))
        if damaged:
            first, at = min(damaged)
            more = f" (and {len(damaged) - 1:,} more files)" if len(damaged) > 1 else ""
            paths = [path for path, _ in sorted(damaged)]
            error = DamagedData(f"{first} is damaged at byte {at:,}{more}", paths=paths)
            error.summary = Summary(source=job.source, truncated_files=len(damaged))
            raise error
    except DamagedData as error:
        hint = f"run `kb {job.source} crawl`: it moves damaged data away and fetches it again"
        quarantine.note(run.root, job.source, error, hint)
        raise
    return rows, unknown


def _texts(run: Run, decoded: _Decoded) -> Iterator[pa.Array[Any]]:
    tasks = decoded.tasks(decoded.job)
    executor = decoded.executor
    for path in map_in_order(executor, collect_texts, tasks, window=executor.window):
        with pa.ipc.open_file(path) as file:
            for number in range(file.num_record_batches):
                yield file.get_batch(number).column(0)
        Path(path).unlink()


def _add_what_no_bucket_has(job: FilterJob, spec: Clean) -> Counter[str]:
    """Add the items without an answer, and an empty first part for each table without rows, so that
    readers find every table.
    """
    out, counts = Path(job.out), Counter[str]()
    if spec.given_up is not None:
        counts = _fail_unanswered(job, spec, spec.given_up)
    tables = [chain.table for chain in spec.chains] + [follow.table for follow in spec.follow]
    for name in (*tables, *(f"shared/{verdict}" for verdict in VERDICTS)):
        declared = table(name)
        path = out / declared.short / "part-00000.parquet"
        if not path.exists():
            write_table(path, declared.arrow().empty_table(), declared, sync=False)
    for leftover in out.rglob(".*.tmp"):  # of a killed worker, whose task another one repeated
        leftover.unlink()
    return counts


def _fail_unanswered(job: FilterJob, spec: Clean, given_up: GivenUp) -> Counter[str]:
    """Count the keys that the crawl gave up on as failed unless they have a row. Pending rows that
    wait for such a key no longer wait.
    """
    lost = dict(given_up.keys(Path(job.root)))
    if not lost:
        return Counter()
    waited = _end_pending(Path(job.out, "pending"), given_up.ends, lost)
    places = [(chain.table, chain.key, chain.prefix) for chain in spec.chains]
    places += [(f"shared/{verdict}", "key", "") for verdict in VERDICTS]
    for name, column, prefix in places:
        for path in parquet_files(Path(job.out, table(name).short)):
            for key in parquet.read_table(path, columns=[column])[column].to_pylist():
                lost.pop(f"{prefix}{key}", None)
    for key in purged_keys(job.root, job.source, job.tombstones):
        lost.pop(key, None)
    if lost:
        rows = pa.table({"key": list(lost), "reason": list(lost.values())})
        write_table(Path(job.out, "failed", "part-crawl.parquet"), rows, "shared/failed")
    return Counter(crawled=len(lost) - waited, failed=len(lost), pending=-waited)


def _end_pending(folder: Path, reasons: tuple[str, ...], lost: dict[str, str]) -> int:
    """Remove the pending rows of these keys with one of these reasons; return their number."""
    count = 0
    for path in parquet_files(folder) if reasons else ():
        rows = parquet.read_table(path)
        ended = pc.and_(
            pc.is_in(rows["key"].cast(pa.string()), pa.array(lost, pa.string())),
            pc.is_in(rows["reason"].cast(pa.string()), pa.array(reasons, pa.string())),
        )
        waiting = rows.filter(pc.invert(ended))
        if waiting.num_rows < rows.num_rows:
            count += rows.num_rows - waiting.num_rows
            path.unlink()
            if waiting.num_rows:
                write_table(path, waiting, "shared/pending", sync=False)
    return count


def _check_rows(spec: Clean, decoded: _Decoded, counts: Counter[str]) -> None:
    """Raise CountMismatch unless the buckets read what was decoded, and judged what they joined."""
    rows = sum(counts.total() for kind, counts in decoded.rows.items() if decoded.bucketed(kind))
    if rows != counts["read"] or counts["joined"] != counts["crawled"]:
        raise CountMismatch(
            f"{spec.source}: {rows:,} rows were decoded and {counts['read']:,} read again;"
            f" {counts['joined']:,} were joined and {counts['crawled']:,} judged",
            hint="this is a bug in Lorecrawl; no output was replaced",
        )


def _summary(
    spec: Clean, folder: Path, unknown: Counter[str], counts: Counter[str], key: str
) -> Summary:
    """The numbers of the written files, by table. Raises CountMismatch when the workers' differ."""
    tables = {table(chain.table).short: chain.prefix for chain in spec.chains}
    tallies = row_counts.tally(folder, tables)
    names = ("crawled", "kept", "rejected", "failed", "pending")
    total = Tally(*(sum(tally[name] for tally in tallies.values()) for name in names))
    if total.balanced(spec.source) != Tally(*(counts[name] for name in names)):
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
        missing=sum(tally["missing"] for tally in tallies.values()),
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
    summary["unknown_keys"] = dict(sorted(unknown.items()))
    if key:  # of the models whose scores are there, the one whose scores decided; releases name it
        summary["model"], _, summary["revision"] = key.rpartition("@")
    else:
        summary["toxicity"] = "not scored"
    return summary
