"""What a pipeline's `clean(p)` returns, and how a chain of stages judges rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import Run
from kb.core.errors import SchemaMismatch
from kb.filters.predicates import SCORED, Judgement, Predicate
from kb.filters.thresholds import outcome_of_other_stages, thresholds
from kb.schema.tables import table
from kb.store.layout import VERDICTS
from kb.store.tables.columns import column, with_nulls
from kb.store.tables.partition import RawKind

_DESCRIPTION = (  # columns of shared/rejected that say what was dropped
    *("title", "text", "channel_id", "channel_title", "type", "post_id", "parent_id"),
)
_WORDS = ("title", "text")
_LONGEST = 1000  # characters of a description


class Scorer(Protocol):
    """Scores of texts, stored apart from the rows (kb.annotate.toxicity)."""

    def model_key(self, run: Run, source: str) -> str:
        """A key that stands for the model in workers; "" when the profile scores nothing.

        Raises exit 2.
        """

    def annotate(self, run: Run, source: str, texts: Iterable[pa.Array[Any]]) -> Any:
        """Score the texts that have no score yet."""

    def scores(self, key: str, root: Path, source: str, texts: pa.Array[Any]) -> pa.Table:
        """The categories' scores of each text, float32, null for empty texts. Runs in workers."""


class PurgeKeys(NamedTuple):
    """How tombstones name rows besides by their key: by what is in one of the columns `also` (a
    page's title), or as those of a person, who stands in the column `person`; the tombstone has
    `stands_for` of its value.
    """

    also: tuple[str, ...] = ()
    person: str = ""
    stands_for: Callable[[str], str] = str


class Description(NamedTuple):
    """What readers of shared/rejected see of a row: columns of that table → columns of the rows;
    not its words where the column `gone` says that they were taken down.
    """

    columns: Mapping[str, str] = {}
    gone: str = ""


@dataclass(frozen=True)
class Chain:
    """The stages of one table, in order.

    `prefix` comes before the key in rejected, failed and pending ("t3_"). `scores` maps a text
    column to the column of its largest toxicity category, and they are joined before the stage
    SCORED. `helpers` are columns that stages use and no table has. `relate` gets the rows and the
    tables that were kept before, and adds what depends on these (comments need their posts).
    """

    table: str
    key: str
    stages: tuple[Predicate, ...]
    prefix: str = ""
    scores: Mapping[str, str] = field(default_factory=dict)
    helpers: tuple[str, ...] = ()
    relate: Callable[[pa.Table, Mapping[str, pa.Table]], pa.Table] | None = None
    purged: PurgeKeys = field(default_factory=PurgeKeys)
    described: Description = field(default_factory=Description)


@dataclass(frozen=True)
class Follow:
    """A table whose rows are kept when their row of the table `of` is:
    transcripts of kept videos.
    """

    table: str
    of: str
    on: str


class SideFiles(NamedTuple):
    """Files outside the raw log that its answers name: captured pages.

    `read` takes the data root, the joined tables, and whether the tables that follow are wanted
    as well; it returns the tables with the content of the files. `size` is their size in bytes of
    compressed raw data, which decides the number of buckets.
    """

    read: Callable[[Path, dict[str, Any], bool], dict[str, Any]]
    size: Callable[[Path], int]


class RawRows(NamedTuple):
    """How raw answers become rows of the clean tables: `kinds` are decoded, and `assemble` takes
    the newest rows of each kind (of one bucket) and returns rows by table name.
    """

    kinds: Mapping[str, RawKind]
    assemble: Callable[[dict[str, pa.Table]], dict[str, pa.Table]]
    side_files: SideFiles | None = None


class GivenUp(NamedTuple):
    """What a crawl gave up on: `keys` of the data root without a row, with the reason, count as
    failed, and so does such a key that is pending for one of the reasons `ends`.
    """

    keys: Callable[[Path], Iterable[tuple[str, str]]]
    ends: tuple[str, ...] = ()


@dataclass(frozen=True)
class Clean:
    """Raw answers → clean tables of one source.

    `complete` gets the kept tables of a bucket, and adds columns that depend on what else was kept
    (the number of comments of a post) or that only kept rows need. `across` gets the data root
    and the folder of the new clean tables, fills columns or tables that depend on all buckets (the
    page that a title means), and returns by how many rows it changed which table. `figures`
    gets the data root and that folder, and adds figures to the summary.
    """

    source: str
    raw: RawRows
    chains: tuple[Chain, ...]
    follow: tuple[Follow, ...] = ()
    scorer: Scorer | None = None
    given_up: GivenUp | None = None
    complete: Callable[[dict[str, pa.Table]], dict[str, pa.Table]] | None = None
    across: Callable[[Path, Path], Mapping[str, int]] | None = None
    figures: Callable[[Path, Path], Mapping[str, Any]] | None = None


class Judged(NamedTuple):
    """Rows of one chain by outcome; all but `kept` have the columns of shared/<verdict>."""

    kept: pa.Table
    rejected: pa.Table
    failed: pa.Table
    pending: pa.Table


class KeptRows(dict[str, pa.Table]):
    """Kept rows by table; none of a table that the bucket has no rows of."""

    def __missing__(self, name: str) -> pa.Table:
        return table(name).arrow().empty_table()


def judge_chain(
    rows: pa.Table,
    chain: Chain,
    join: Callable[[pa.Table], pa.Table],
    kept: Mapping[str, pa.Table] | None = None,
    *,
    until: str = "",
) -> Judged:
    """Run the chain over rows. `join` adds the scores before the stage SCORED; `kept` are the rows
    that earlier chains kept, by table.

    `until` names a stage to stop before: the rows that reach it are `kept`, and the others are left
    out. Raises SchemaMismatch when a stage reads a column that is not there.
    """
    if chain.relate is not None:
        rows = chain.relate(rows, KeptRows(kept or {}))
    out: dict[str, list[pa.Table]] = {verdict: [] for verdict in VERDICTS}
    joined = False
    for position, stage in enumerate(chain.stages):
        if until and stage.stage == until:
            break
        if stage.stage == SCORED and not joined:
            rows, joined = join(rows), True
        rows = stage.fill(rows)
        lacking = stage.reads - set(rows.column_names)
        if lacking:
            raise SchemaMismatch(
                f"{chain.table}: stage {stage.stage} reads {', '.join(sorted(lacking))},"
                " which no row has"
            )
        if not rows.num_rows:
            continue
        judged = stage.judge(rows)
        out_of = pc.is_valid(judged.reason)
        if pc.any(out_of).as_py():
            if not until:  # whoever stops early asks for what is kept
                for verdict, result in _verdicts(
                    rows.filter(out_of), judged.filter(out_of), chain, position
                ):
                    out[verdict].append(result)
            rows = rows.filter(pc.invert(out_of))
    if not until and not joined:
        rows = join(rows)
    done = [
        pa.concat_tables([table(f"shared/{verdict}").arrow().empty_table(), *out[verdict]])
        for verdict in VERDICTS
    ]
    return Judged(rows, *done)


def _verdicts(
    rows: pa.Table, judged: Judgement, chain: Chain, position: int
) -> Iterator[tuple[str, pa.Table]]:
    """The rows that a stage drops, as rows of shared/<verdict>."""
    predicate = chain.stages[position]
    key = pc.binary_join_element_wise(
        chain.prefix, rows.column(chain.key).cast(pa.string()).combine_chunks(), ""
    )
    matched, unmatched = predicate.conditions(rows)
    verdicts = pa.table(
        {
            "key": key,
            "stage": pa.repeat(predicate.stage, rows.num_rows),
            "reason": judged.reason,
            "value": judged.value,
            "threshold": pa.repeat(pa.scalar(judged.threshold, pa.string()), rows.num_rows),
            **_about_threshold(rows, chain, position),
            **_description(rows, chain),
            "matched": matched,
            "unmatched": unmatched,
        }
    )
    for verdict in VERDICTS:
        schema = table(f"shared/{verdict}").arrow()
        if isinstance(judged.verdict, str):
            hits = verdicts if judged.verdict == verdict else verdicts.slice(0, 0)
        else:
            hits = verdicts.filter(pc.equal(judged.verdict, verdict))
        if hits.num_rows:
            yield verdict, hits.select(schema.names).cast(schema)


def _description(rows: pa.Table, chain: Chain) -> dict[str, pa.Array[Any]]:
    """What readers of shared/rejected see of the rows."""
    nulls: pa.Array[Any] = pa.nulls(rows.num_rows, pa.string())
    described: dict[str, pa.Array[Any]] = {}
    columns, withheld = chain.described
    taken_down = pc.is_valid(column(rows, withheld)) if withheld else None
    for name in _DESCRIPTION:
        source = columns.get(name, "")
        if source not in rows.column_names:
            described[name] = nulls
            continue
        values = pc.utf8_slice_codeunits(column(rows, source).cast(pa.string()), 0, _LONGEST)
        is_withheld = taken_down is not None and name in _WORDS
        described[name] = pc.if_else(taken_down, nulls, values) if is_withheld else values
    return described


def _about_threshold(rows: pa.Table, chain: Chain, position: int) -> dict[str, pa.Array[Any]]:
    """What `kb explore` needs to try another threshold; nulls of a stage without one."""
    stage = chain.stages[position].stage
    for threshold in thresholds(chain.stages):
        if threshold.stage == stage:
            number = threshold.numbers(rows)
            outcome = outcome_of_other_stages(rows, chain.stages, position, tuple(chain.scores))
            known = pc.if_else(pc.is_valid(number), outcome, pa.scalar(None, pa.string()))
            return {"number": number, "other_stages": known}
    return {
        "number": pa.nulls(rows.num_rows, pa.float64()),
        "other_stages": pa.nulls(rows.num_rows, pa.string()),
    }


def declared_columns(rows: pa.Table, chain: Chain) -> pa.Table:
    """The rows with the columns of their table: parse's inputs and helpers dropped,
    nullable ones that are missing as null.
    """
    declared = table(chain.table)
    names = set(declared.names())
    mine = {column.name for column in declared.inputs} | {"problems", *chain.helpers}
    rows = rows.drop_columns(
        [name for name in rows.column_names if name in mine and name not in names]
    )
    return with_nulls(rows, declared.arrow())
