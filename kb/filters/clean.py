"""`kb <source> filter`: raw answers → clean/<source>/, every record kept, rejected, failed or pending.

    parse      a task a raw segment: rows spread over buckets (kb.filters.buckets)
    texts      a task a bucket: texts that reach the toxicity stage; what has no score yet is scored
    sort       a task a bucket: newest rows joined, stages in order, part files written

Workers get paths and names only: they load the pipeline by its path. The folder clean/<source>
takes the old one's place whole, after the counts were checked. Tombstones are left out.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from kb.core import pipeline
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError
from kb.core.profile import Profile
from kb.core.verdict import Summary, Tally
from kb.filters import buckets
from kb.filters.chain import VERDICTS, Chain, Clean, Sorted, declared_columns, sort_rows
from kb.schema.tables import table
from kb.store import rawlog, tombstones
from kb.store.atomic import full_disk_is_resumable, replacing_folder, write_text
from kb.store.lock import writer
from kb.store.shards import write_table

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.core.context import Run


class Job(NamedTuple):
    """What a worker needs to know; plain strings and numbers."""

    pipeline: str
    profile: str
    profile_path: str
    source: str
    root: str
    work: str
    out: str
    buckets: int
    scores: str
    tombstones: int  # when their file was changed, so that no process trusts an older one


def run_clean(run: Run, source: str) -> Summary:
    """Sort a source's raw answers. Returns the tally, the stages' counts and what was odd.

    Raises FatalError without raw data, CountMismatch, WriterLocked, DiskFull, and what the scorer
    raises without its model.
    """
    run.profile.section(source)
    job = _job(run, source)
    spec = _spec(job)
    key = spec.scorer.check(run, source) if spec.scorer is not None else ""
    with writer(run.root, source), _work(job) as work:
        segments = _segments(run.root, spec)
        job = job._replace(work=str(work), buckets=buckets.how_many([path for _, path in segments]), scores=key)
        with make_executor(run.engine, run.workers, run.scheduler) as executor:
            parsed = _parse(run, job, segments, executor)
            if key and spec.scorer is not None:
                spec.scorer.annotate(run, source, _texts(run, job, executor))
            with replacing_folder(run.root / "clean" / source) as fresh:
                job = job._replace(out=str(fresh))
                counts = _sort(run, job, executor)
                summary = _summary(source, parsed, counts, bool(key))
                write_text(fresh / "summary.json", json.dumps(summary, indent=1) + "\n")
    return summary


def texts(run: Run, source: str) -> Iterator[pa.Array]:
    """The texts that the toxicity stage of a source would look at, for `kb annotate`."""
    job = _job(run, source)
    with writer(run.root, source), _work(job) as work:
        segments = _segments(run.root, _spec(job))
        job = job._replace(work=str(work), buckets=buckets.how_many([path for _, path in segments]))
        with make_executor(run.engine, run.workers, run.scheduler) as executor:
            _parse(run, job, segments, executor)
            yield from _texts(run, job, executor)


def _job(run: Run, source: str) -> Job:
    path = str(pipeline.locate(source, run.pipeline))
    gone = tombstones.path(run.root, source)
    stamp = gone.stat().st_mtime_ns if gone.exists() else 0
    return Job(path, run.profile.model_dump_json(), str(run.profile.path), source, str(run.root.absolute()), "", "", 1, "", stamp)


class _work:
    """A folder for rows on their way, gone at the end."""

    def __init__(self, job: Job) -> None:
        self.path = Path(job.root, "clean", f".{job.source}.work")

    def __enter__(self) -> Path:
        shutil.rmtree(self.path, ignore_errors=True)
        self.path.mkdir(parents=True)
        return self.path

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)


@cache
def _load(path: str, profile: str, profile_path: str, source: str) -> Clean:
    made = Profile.model_validate({**json.loads(profile), "path": profile_path})
    spec = pipeline.load(path).clean(made)
    if not isinstance(spec, Clean) or spec.source != source:
        raise FatalError(f"{path}: clean(p) must return the Clean of {source}")
    return spec


def _spec(job: Job) -> Clean:
    return _load(job.pipeline, job.profile, job.profile_path, job.source)


def _segments(root: Path, spec: Clean) -> list[tuple[str, Path]]:
    found = [(kind, path) for kind in spec.kinds for path in rawlog.segments(root, spec.source, kind)]
    if not found:
        raise FatalError(f"nothing to filter: {root / 'raw' / spec.source} is empty", hint=f"run `kb {spec.source} crawl` first")
    return found


def _parse(run: Run, job: Job, segments: list[tuple[str, Path]], executor: Any) -> Counter[str]:
    """Counts of rows, and of unknown keys as "?<path>"."""
    total: Counter[str] = Counter()
    task = run.progress.task(f"parse {job.source}", total=len(segments), unit="segments")
    tasks = ((job, kind, str(path), place) for place, (kind, path) in enumerate(segments))
    for number, done in enumerate(map_in_order(executor, _parse_one, tasks, window=2 * run.workers)):
        total["rows"] += done["rows"]
        total.update({f"?{path}": count for path, count in done["unknown"].items()})
        if done["torn"]:
            total["truncated_files"] += 1
            run.progress.say(f"{segments[number][1]} is cut off: what is whole in it was read")
        task.advance(1, rows=total["rows"])
    task.close()
    return total


def _parse_one(job: Job, kind: str, segment: str, number: int) -> dict[str, Any]:
    with full_disk_is_resumable(Path(job.work)):
        return buckets.spread(_spec(job).kinds[kind], f"{job.source}/{kind}", Path(segment), number, Path(job.work, kind), job.buckets)


def _texts(run: Run, job: Job, executor: Any) -> Iterator[pa.Array]:
    import pyarrow as pa

    tasks = ((job, number) for number in range(job.buckets))
    for path in map_in_order(executor, _texts_of, tasks, window=2 * run.workers):
        with pa.ipc.open_file(path) as file:
            for number in range(file.num_record_batches):
                yield file.get_batch(number).column(0)
        Path(path).unlink()


def _texts_of(job: Job, number: int) -> str:
    """Write the texts of a bucket that reach their toxicity stage to a file; its path."""
    import pyarrow as pa

    spec = _spec(job)
    path = str(Path(job.work, f"texts-{number:06d}.arrow"))
    schema = pa.schema([("text", pa.string())])
    with full_disk_is_resumable(Path(job.work)), pa.ipc.new_file(path, schema) as file:
        for chain, done in _walk(job, spec, number, lambda chain, rows: rows, dry=True)[0]:
            for column in chain.scores if chain.scores else ():
                for chunk in done.kept.column(column).chunks:
                    file.write_batch(pa.record_batch([chunk.cast(pa.string())], schema=schema))
    return path


def _sort(run: Run, job: Job, executor: Any) -> Counter[str]:
    total: Counter[str] = Counter()
    spec = _spec(job)
    task = run.progress.task(f"filter {job.source}", total=job.buckets, unit="buckets")
    tasks = ((job, number) for number in range(job.buckets))
    for done in map_in_order(executor, _sort_one, tasks, window=2 * run.workers):
        total.update(done)
        task.advance(1, kept=total["kept"], rejected=total["rejected"])
    task.close()
    if spec.unanswered is not None:
        total.update(_unanswered(run, job, spec))
    for cut in Path(job.out).rglob(".*.tmp"):  # of a worker that died; its task was done again by another
        cut.unlink()
    return total


def _sort_one(job: Job, number: int) -> dict[str, int]:
    """Sort one bucket and write its part files; counts for the summary."""
    import pyarrow as pa

    spec = _spec(job)

    def join(chain: Chain, rows: pa.Table) -> pa.Table:
        return _join(job, spec, chain, rows)

    done, follows, counts = _walk(job, spec, number, join)
    for chain, found in done:
        counts["crawled"] += sum(part.num_rows for part in found)
        counts["kept"] += found.kept.num_rows
        counts[f"kept {chain.table}"] += found.kept.num_rows
        _write(job, chain.table, number, declared_columns(found.kept, chain))
    for name, rows in follows.items():
        counts[f"kept {name}"] += rows.num_rows
        _write(job, name, number, rows)
    for verdict in VERDICTS if done else ():  # a bucket may be empty
        rows = pa.concat_tables([getattr(found, verdict) for _, found in done])
        counts[verdict] += rows.num_rows
        for entry in rows.group_by(["stage"]).aggregate([([], "count_all")]).to_pylist() if verdict == "rejected" else ():
            counts[f"stage {entry['stage']}"] += entry["count_all"]
        _write(job, f"shared/{verdict}", number, rows)
    return dict(counts)


def _walk(job: Job, spec: Clean, number: int, join: Any, dry: bool = False) -> tuple[list[tuple[Chain, Sorted]], dict[str, pa.Table], Counter[str]]:
    """Assemble a bucket and run its chains; `dry` stops each that has scores before its scored stage."""
    import pyarrow.compute as pc

    counts: Counter[str] = Counter()
    newest: dict[str, Any] = {}
    for kind, about in spec.kinds.items():
        newest[kind], older = buckets.newest(Path(job.work, kind, str(number)), about)
        counts["duplicates"] += older
    rows = spec.assemble({kind: part for kind, part in newest.items() if part is not None})
    gone = _tombstones(job.root, job.source, job.tombstones)
    kept: dict[str, pa.Table] = {}
    done = []
    for chain in spec.chains:
        if chain.table not in rows:
            continue
        mine = rows[chain.table](kept) if callable(rows[chain.table]) else rows[chain.table]
        mine = _without(mine, chain, gone)
        until = chain.scored if dry and chain.scores else ""
        found = sort_rows(mine, chain, lambda part, chain=chain: join(chain, part), until=until)
        kept[chain.table] = found.kept
        done.append((chain, found))
    follows = {}
    for follow in spec.follow if not dry else ():
        if follow.table in rows and follow.of in kept:
            mine = rows[follow.table]
            there = pc.is_in(mine.column(follow.on), kept[follow.of].column(follow.on).combine_chunks())
            follows[follow.table] = mine.filter(there)
    return done, follows, counts


def _without(rows: pa.Table, chain: Chain, gone: frozenset[str]) -> pa.Table:
    import pyarrow as pa
    import pyarrow.compute as pc

    if not gone:
        return rows
    bare = [key.removeprefix(chain.prefix) for key in gone if key.startswith(chain.prefix)]
    return rows.filter(pc.invert(pc.is_in(rows.column(chain.key).cast(pa.string()), pa.array(bare, pa.string()))))


@cache
def _tombstones(root: str, source: str, changed: int) -> frozenset[str]:
    return frozenset(tombstones.keys(Path(root), source))


def _join(job: Job, spec: Clean, chain: Chain, rows: pa.Table) -> pa.Table:
    """The rows with a column for each category of each scored text, and one for the largest; null when nothing is scored."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for column, largest in chain.scores.items():
        if not job.scores or spec.scorer is None:
            rows = rows.append_column(largest, pa.nulls(rows.num_rows, pa.float32()))
            continue
        texts_of = rows.column(column).combine_chunks()
        got = spec.scorer.scores(job.scores, Path(job.root), job.source, texts_of.cast(pa.string()))
        top = pc.max_element_wise(*(got.column(name).combine_chunks() for name in got.column_names))
        rows = rows.append_column(largest, top.cast(pa.float32()))
        for name in got.column_names:
            rows = rows.append_column(f"{largest}_{name}", got.column(name))
    return rows


def _write(job: Job, name: str, number: int, rows: pa.Table) -> None:
    """A part file; empty ones only for the first bucket, so that each table is there."""
    if rows.num_rows or number == 0:
        write_table(Path(job.out, table(name).short, f"part-{number:05d}.parquet"), rows, name, sync=False)


def _unanswered(run: Run, job: Job, spec: Clean) -> dict[str, int]:
    """Keys that the crawl gave up on and that have no row: failed."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    assert spec.unanswered is not None
    lost = dict(spec.unanswered(run.root))
    places = [(chain.table, chain.key, chain.prefix) for chain in spec.chains] + [(f"shared/{verdict}", "key", "") for verdict in VERDICTS]
    for name, column, prefix in places if lost else ():
        for path in Path(job.out, table(name).short).glob("*.parquet"):
            for key in pq.read_table(path, columns=[column])[column].to_pylist():
                lost.pop(f"{prefix}{key}", None)
    for key in _tombstones(job.root, job.source, job.tombstones) if lost else ():
        lost.pop(key, None)
    if lost:
        rows = pa.table({"key": list(lost), "reason": list(lost.values())})
        write_table(Path(job.out, "failed", "part-crawl.parquet"), rows, "shared/failed")
    return {"crawled": len(lost), "failed": len(lost)}


def _summary(source: str, parsed: Counter[str], counts: Counter[str], scored: bool) -> Summary:
    tally = Tally(*(counts[name] for name in ("crawled", "kept", "rejected", "failed", "pending")))
    tally.check(source)
    summary = Summary(source=source, crawled=tally.crawled, kept=tally.kept, rejected=tally.rejected, failed=tally.failed, pending=tally.pending)
    summary["missing"] = counts["stage missing"]
    summary["duplicates"] = counts["duplicates"]
    summary["truncated_files"] = parsed["truncated_files"]
    summary["stages"] = {name.removeprefix("stage "): count for name, count in sorted(counts.items()) if name.startswith("stage ")}
    summary["tables"] = {name.removeprefix("kept "): count for name, count in sorted(counts.items()) if name.startswith("kept ")}
    summary["unknown_keys"] = {path[1:]: count for path, count in sorted(parsed.items()) if path.startswith("?")}
    if not scored:
        summary["toxicity"] = "not scored"
    return summary
