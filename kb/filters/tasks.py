"""What a worker does for `kb <source> filter`: parse one segment, or look for texts in one bucket,
or sort it.

A task is a `FilterJob` and the name of a segment or the number of a bucket; the pipeline is loaded
by its path. Nothing here holds more than a bucket.
"""

from __future__ import annotations

import json
import shutil
import uuid
from collections import Counter
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import pipeline
from kb.core.errors import FatalError
from kb.core.profile import Profile
from kb.filters.chain import VERDICTS, Chain, Clean, Sorted, declared_columns, sort_rows
from kb.filters.judgement import SCORED
from kb.schema.tables import table
from kb.store import buckets, tombstones
from kb.store.atomic import full_disk_is_resumable
from kb.store.shards import write_table


class FilterJob(NamedTuple):
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


@cache
def _load(path: str, profile: str, profile_path: str, source: str) -> Clean:
    made = Profile.model_validate({**json.loads(profile), "path": profile_path})
    spec = pipeline.load(path).clean(made)
    if not isinstance(spec, Clean) or spec.source != source:
        raise FatalError(f"{path}: clean(p) must return the Clean of {source}")
    return spec


def spec_of(job: FilterJob) -> Clean:
    return _load(job.pipeline, job.profile, job.profile_path, job.source)


def parse_segment(job: FilterJob, kind: str, segment: str, number: int) -> dict[str, Any]:
    with full_disk_is_resumable(Path(job.work)):
        return buckets.spread(
            spec_of(job).kinds[kind],
            f"{job.source}/{kind}",
            Path(segment),
            number,
            Path(job.work, kind),
            job.buckets,
            mending=True,
        )


def texts_of(job: FilterJob, number: int, keep: bool) -> str:
    """Write the texts of a bucket that reach their toxicity stage to a file; its path.

    `keep`: the bucket is sorted afterwards, so what was assembled stays for that.
    """
    spec = spec_of(job)
    path = str(Path(job.work, f"texts-{number:06d}.arrow"))
    schema = pa.schema([("text", pa.string())])
    with full_disk_is_resumable(Path(job.work)), pa.ipc.new_file(path, schema) as file:
        with buckets.without_collecting():
            rows, counts = _assembled(job, spec, number, whole=keep)
        if keep:
            _keep(job, spec, number, rows, counts)
        for chain, done in _walk(job, spec, rows, lambda chain, rows: rows, dry=True)[0]:
            for column in chain.scores or ():
                for chunk in done.kept.column(column).chunks:
                    file.write_batch(pa.record_batch([chunk.cast(pa.string())], schema=schema))
    return path


def sort_bucket(job: FilterJob, number: int) -> dict[str, int]:
    """Sort one bucket and write its part files; counts for the summary."""
    spec = spec_of(job)

    def join(chain: Chain, rows: pa.Table) -> pa.Table:
        return _join(job, spec, chain, rows)

    with buckets.without_collecting():
        rows, counts = _assembled(job, spec, number, whole=True)
    done, follows = _walk(job, spec, rows, join)
    whole = {chain.table: result.kept for chain, result in done}
    if spec.complete is not None:
        whole = spec.complete(whole)
    for chain, result in done:
        counts["crawled"] += sum(part.num_rows for part in result)
        counts["kept"] += result.kept.num_rows
        counts[f"kept {chain.table}"] += result.kept.num_rows
        _write(job, chain.table, number, declared_columns(whole[chain.table], chain))
    for name, followed in follows.items():
        counts[f"kept {name}"] += followed.num_rows
        _write(job, name, number, followed)
    for verdict in VERDICTS if done else ():  # a bucket may be empty
        out = pa.concat_tables([getattr(result, verdict) for _, result in done])
        counts[verdict] += out.num_rows
        for entry in (
            out.group_by(["stage"]).aggregate([([], "count_all")]).to_pylist()
            if verdict == "rejected"
            else ()
        ):
            counts[f"stage {entry['stage']}"] += entry["count_all"]
        _write(job, f"shared/{verdict}", number, out)
    return dict(counts)


def _assembled(
    job: FilterJob, spec: Clean, number: int, *, whole: bool
) -> tuple[dict[str, pa.Table], Counter[str]]:
    """The rows of a bucket by table, and its counts; those that were kept, if any were.

    Without `whole` the tables that follow others may be empty.
    """
    kept = _place(job, number)
    if kept.is_dir():
        return _read_kept(kept)
    newest, counts = _newest(job, spec, number)
    if not newest:
        return {}, counts
    rows = spec.assemble(newest)
    gone = removed_keys(job.root, job.source, job.tombstones)
    for chain in spec.chains:
        if chain.table in rows:
            rows[chain.table] = _without(rows[chain.table], chain, gone)
    if spec.side_files is not None:
        rows = spec.side_files.read(Path(job.root), rows, whole)
    return rows, counts


def _place(job: FilterJob, number: int) -> Path:
    return Path(job.work, "assembled", str(number))


def _keep(
    job: FilterJob, spec: Clean, number: int, rows: dict[str, pa.Table], counts: Counter[str]
) -> None:
    """Keep what was assembled, in place of the rows that it was assembled of.

    The folder appears whole, so a task that is done again by another worker finds one or the other.
    """
    place = _place(job, number)
    if place.is_dir():
        return
    fresh = place.with_name(f".{number}.{uuid.uuid4().hex[:8]}")
    fresh.mkdir(parents=True)
    for name, part in rows.items():
        path = fresh / f"{name.replace('/', '.')}.arrow"
        with pa.ipc.new_file(str(path), part.schema) as file:
            file.write_table(part)
    (fresh / "counts.json").write_text(json.dumps([list(rows), counts]))
    fresh.rename(place)
    for kind, about in spec.kinds.items():
        if about.bucket:  # all buckets read the others
            shutil.rmtree(Path(job.work, kind, str(number)), ignore_errors=True)


def _read_kept(place: Path) -> tuple[dict[str, pa.Table], Counter[str]]:
    names, counts = json.loads((place / "counts.json").read_text())
    rows = {}
    for name in names:
        with pa.ipc.open_file(
            pa.memory_map(str(place / f"{name.replace('/', '.')}.arrow"))
        ) as file:
            rows[name] = file.read_all()
    return rows, Counter(counts)


def _walk(
    job: FilterJob, spec: Clean, rows: dict[str, pa.Table], join: Any, dry: bool = False
) -> tuple[list[tuple[Chain, Sorted]], dict[str, pa.Table]]:
    """Run the chains of a bucket; `dry` stops each that has scores before its scored stage."""
    kept: dict[str, pa.Table] = {}
    done = []
    for chain in spec.chains:
        if chain.table not in rows:
            continue
        mine = rows[chain.table]
        if chain.relate is not None:
            mine = chain.relate(mine, kept)
        until = SCORED if dry and chain.scores else ""
        result = sort_rows(mine, chain, partial(join, chain), until=until)
        kept[chain.table] = result.kept
        done.append((chain, result))
    follows = {}
    for follow in spec.follow if not dry else ():
        if follow.table in rows and follow.of in kept:
            mine = rows[follow.table]
            there = pc.is_in(
                mine.column(follow.on), kept[follow.of].column(follow.on).combine_chunks()
            )
            follows[follow.table] = mine.filter(there)
    return done, follows


def _newest(job: FilterJob, spec: Clean, number: int) -> tuple[dict[str, pa.Table], Counter[str]]:
    """The newest rows of a bucket by kind, those that any bucket may need among them,
    and how many older ones it had.
    """
    counts: Counter[str] = Counter()
    newest: dict[str, pa.Table] = {}
    for kind, about in spec.kinds.items():
        wanted = None
        if about.named_by[0]:
            namer = newest.get(about.named_by[0])
            if namer is None:
                continue
            wanted = pc.unique(pc.list_flatten(namer.column(about.named_by[1])))
        part, older = buckets.newest_of(
            Path(job.work, kind, str(number) if about.bucket else "0"), about, wanted
        )
        counts["duplicates"] += older if about.bucket else 0
        if part is not None:
            newest[kind] = part
    return newest, counts


def _without(rows: pa.Table, chain: Chain, gone: frozenset[str]) -> pa.Table:
    if not gone:
        return rows
    bare = pa.array(
        [key.removeprefix(chain.prefix) for key in gone if key.startswith(chain.prefix)],
        pa.string(),
    )
    for name in (chain.key, *chain.also):
        rows = rows.filter(pc.invert(pc.is_in(rows.column(name).cast(pa.string()), bare)))
    return rows


@cache
def removed_keys(root: str, source: str, changed: int) -> frozenset[str]:
    return frozenset(tombstones.keys(Path(root), source))


def _join(job: FilterJob, spec: Clean, chain: Chain, rows: pa.Table) -> pa.Table:
    """The rows with the largest category of each scored text,
    and those categories that the table has; null when nothing is scored.
    """
    declared = table(chain.table).names()
    for column, largest in chain.scores.items():
        if not job.scores or spec.scorer is None:
            rows = rows.append_column(largest, pa.nulls(rows.num_rows, pa.float32()))
            continue
        texts_of = rows.column(column).combine_chunks()
        got = spec.scorer.scores(job.scores, Path(job.root), job.source, texts_of.cast(pa.string()))
        top = pc.max_element_wise(*(got.column(name).combine_chunks() for name in got.column_names))
        rows = rows.append_column(largest, top.cast(pa.float32()))
        for name in got.column_names:
            if f"{largest}_{name}" in declared:
                rows = rows.append_column(f"{largest}_{name}", got.column(name))
    return rows


def _write(job: FilterJob, name: str, number: int, rows: pa.Table) -> None:
    if rows.num_rows:
        write_table(
            Path(job.out, table(name).short, f"part-{number:05d}.parquet"), rows, name, sync=False
        )
