"""What a worker does for `kb <source> filter`, in the order in which a row travels:

    decode       lines of a raw segment to rows                          } a task per segment:
    partition    rows to buckets by key                                  } `decode_segment`
    latest       the newest row of each key of a bucket                  )
    join         rows of all kinds to rows of the clean tables           ) a task per bucket:
    judge_chain  each row is kept, rejected, failed or pending           ) `filter_bucket`
    write        one part file per table and verdict                     )

`collect_texts` does `latest`, `join` and a part of `judge_chain` before, to find the texts that
need a toxicity score. A task is a `FilterJob` and the name of a segment or the number of a bucket;
the recipe is made of its name or text. No function holds more than a bucket.
"""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.config.pipeline import Recipe
from kb.core.config.profile import Profile
from kb.core.errors import FatalError
from kb.filters.chain import Chain, Clean, Judged, declared_columns, judge_chain
from kb.filters.predicates import SCORED
from kb.schema.tables import table
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import VERDICTS
from kb.store.state import tombstones
from kb.store.tables import partition
from kb.store.tables.columns import where
from kb.store.tables.shard_writer import write_table


class FilterJob(NamedTuple):
    """What a worker needs to know, as plain strings and numbers."""

    recipe: Recipe
    profile: str
    profile_path: str
    source: str
    root: str
    tombstones: int  # their version, so that no process uses an older one
    work: str = ""
    out: str = ""
    buckets: int = 1
    scores: str = ""
    restored: bool = False  # what is released was judged, so that all rows that are there pass


@lru_cache(maxsize=8)
def _recipe_spec(
    recipe: Recipe, profile: str, profile_path: str, source: str, restored: bool
) -> Clean:
    made = Profile.model_validate({**json.loads(profile), "path": profile_path})
    spec = recipe.defined("clean")(made)
    if restored:
        spec = recipe.defined("restored", unjudged)(made, spec)
    if not isinstance(spec, Clean) or spec.source != source:
        where = recipe.path or recipe.name
        raise FatalError(f"{where}: clean(p) must return the Clean of {source}")
    return spec


def spec_of(job: FilterJob) -> Clean:
    return _recipe_spec(job.recipe, job.profile, job.profile_path, job.source, job.restored)


def unjudged(profile: Profile, spec: Clean) -> Clean:
    """The same tables with every row."""
    chains = (replace(chain, stages=(), scores={}) for chain in spec.chains)
    return replace(spec, chains=tuple(chains), scorer=None)


def decode_segment(job: FilterJob, kind: str, segment: str, number: int) -> dict[str, Any]:
    """Decode a raw segment and partition its rows; counts and damage as in `partition.spread`."""
    with full_disk_is_resumable(Path(job.work)):
        return partition.spread(
            spec_of(job).raw.kinds[kind],
            f"{job.source}/{kind}",
            Path(segment),
            number,
            Path(job.work, kind),
            job.buckets,
            skip_damage=True,
        )


def collect_texts(job: FilterJob, number: int, decoded: Mapping[str, int]) -> str:
    """Write the texts of a bucket that reach their toxicity stage to a file; return its path.

    `decoded`: by kind the rows that were written to the bucket.
    """
    spec = spec_of(job)
    path = str(Path(job.work, f"texts-{number:06d}.arrow"))
    schema = pa.schema([("text", pa.string())])
    with full_disk_is_resumable(Path(job.work)), pa.ipc.new_file(path, schema) as file:
        with partition.without_collecting():
            rows, _ = join(job, spec, number, decoded, follows=False)
        kept: dict[str, pa.Table] = {}
        for chain in (chain for chain in spec.chains if chain.table in rows):
            until = SCORED if chain.scores else ""
            judged = judge_chain(rows[chain.table], chain, lambda rows: rows, kept, until=until)
            kept[chain.table] = judged.kept
            for column in chain.scores:
                for chunk in judged.kept.column(column).chunks:
                    file.write_batch(pa.record_batch([chunk.cast(pa.string())], schema=schema))
    return path


def filter_bucket(job: FilterJob, number: int, decoded: Mapping[str, int]) -> dict[str, int]:
    """Join, judge and write one bucket; return counts for the summary."""
    spec = spec_of(job)
    with partition.without_collecting():
        rows, counts = join(job, spec, number, decoded, follows=True)
    judged: list[tuple[Chain, Judged]] = []
    kept: dict[str, pa.Table] = {}
    for chain in (chain for chain in spec.chains if chain.table in rows):
        score = partial(add_scores, job, spec, chain)
        counts["joined"] += rows[chain.table].num_rows
        judged.append((chain, judge_chain(rows[chain.table], chain, score, kept)))
        kept[chain.table] = judged[-1][1].kept
    for follow in spec.follow:
        if follow.table in rows and follow.of in kept:
            of_kept = kept[follow.of].column(follow.on).combine_chunks()
            own = rows[follow.table]
            kept[follow.table] = where(own, pc.is_in(own.column(follow.on), of_kept))
    if spec.complete is not None:
        kept = spec.complete(kept)
    for follow in (follow for follow in spec.follow if follow.table in kept):
        counts[f"kept {follow.table}"] += kept[follow.table].num_rows
        write_part(job, follow.table, number, kept[follow.table])
    for chain, result in judged:
        counts["crawled"] += sum(part.num_rows for part in result)
        counts["kept"] += result.kept.num_rows
        counts[f"kept {chain.table}"] += result.kept.num_rows
        write_part(job, chain.table, number, declared_columns(kept[chain.table], chain))
    for verdict in VERDICTS if judged else ():  # a bucket may be empty
        out = pa.concat_tables([getattr(result, verdict) for _, result in judged])
        counts[verdict] += out.num_rows
        if verdict == "rejected":
            for entry in out.group_by(["stage"]).aggregate([([], "count_all")]).to_pylist():
                counts[f"stage {entry['stage']}"] += entry["count_all"]
        write_part(job, f"shared/{verdict}", number, out)
    return dict(counts)


def latest(
    job: FilterJob, spec: Clean, number: int, decoded: Mapping[str, int]
) -> tuple[dict[str, pa.Table], Counter[str]]:
    """The newest rows of a bucket by kind, and how many rows it had and how many older ones.

    Kinds without a bucket are read by every bucket, as far as its other rows name theirs.
    """
    counts: Counter[str] = Counter()
    newest: dict[str, pa.Table] = {}
    for kind, about in spec.raw.kinds.items():
        wanted = None
        if about.named_by[0]:
            namer = newest.get(about.named_by[0])
            if namer is None:
                continue
            wanted = pc.unique(pc.list_flatten(namer.column(about.named_by[1])))
        part, older = partition.newest_of(
            Path(job.work, kind, str(number) if about.bucket else "0"),
            about,
            decoded.get(kind, 0),
            wanted,
        )
        if about.bucket:
            counts["read"] += decoded.get(kind, 0)
            counts["duplicates"] += older
        if part is not None:
            newest[kind] = part
    return newest, counts


def join(
    job: FilterJob, spec: Clean, number: int, decoded: Mapping[str, int], *, follows: bool
) -> tuple[dict[str, pa.Table], Counter[str]]:
    """The rows of a bucket by table, without purged ones, and its counts.

    Without `follows` the tables that follow others may be empty.
    """
    newest, counts = latest(job, spec, number, decoded)
    if not newest:
        return {}, counts
    rows = spec.raw.assemble(newest)
    purged = purged_keys(job.root, job.source, job.tombstones)
    people = _people(job.root, job.source, job.tombstones)
    for chain in spec.chains:
        if chain.table in rows:
            own = _without_purged(rows[chain.table], chain, purged)
            rows[chain.table] = _without_people(own, chain, people)
    if spec.raw.side_files is not None:
        rows = spec.raw.side_files.read(Path(job.root), rows, follows)
    return rows, counts


def add_scores(job: FilterJob, spec: Clean, chain: Chain, rows: pa.Table) -> pa.Table:
    """The rows with the largest category of each scored text, and the categories that the table
    declares; null when nothing is scored.
    """
    declared = table(chain.table).names()
    for column, largest in chain.scores.items():
        if not job.scores or spec.scorer is None:
            rows = rows.append_column(largest, pa.nulls(rows.num_rows, pa.float32()))
            continue
        texts = rows.column(column).combine_chunks()
        scores = spec.scorer.scores(job.scores, Path(job.root), job.source, texts.cast(pa.string()))
        top = pc.max_element_wise(
            *(scores.column(name).combine_chunks() for name in scores.column_names)
        )
        rows = rows.append_column(largest, top.cast(pa.float32()))
        for name in scores.column_names:
            if f"{largest}_{name}" in declared:
                rows = rows.append_column(f"{largest}_{name}", scores.column(name))
    return rows


def write_part(job: FilterJob, name: str, number: int, rows: pa.Table) -> None:
    """Write the rows of a bucket as a part of a table, if there are any. Raises DiskFull."""
    if rows.num_rows:
        path = Path(job.out, table(name).short, f"part-{number:05d}.parquet")
        write_table(path, rows, name, sync=False)


def _without_purged(rows: pa.Table, chain: Chain, purged: frozenset[str]) -> pa.Table:
    if not purged:
        return rows
    bare = pa.array(
        [key.removeprefix(chain.prefix) for key in purged if key.startswith(chain.prefix)],
        pa.string(),
    )
    for name in (chain.key, *chain.purged.also):
        rows = rows.filter(pc.invert(pc.is_in(rows.column(name).cast(pa.string()), bare)))
    return rows


def _without_people(rows: pa.Table, chain: Chain, people: frozenset[str]) -> pa.Table:
    if not people or not chain.purged.person:
        return rows
    column = rows.column(chain.purged.person).cast(pa.string())
    theirs = [
        person
        for person in pc.unique(column).drop_null().to_pylist()
        if chain.purged.stands_for(person) in people
    ]
    return rows.filter(pc.invert(pc.is_in(column, value_set=pa.array(theirs, pa.string()))))


@cache
def _people(root: str, source: str, version: int) -> frozenset[str]:
    """What stands for people who asked to be left out; cached by the version of their file."""
    return tombstones.people(Path(root), source)


@cache
def purged_keys(root: str, source: str, version: int) -> frozenset[str]:
    """The keys of tombstones; cached by the version of their file."""
    return frozenset(tombstones.keys(Path(root), source))
