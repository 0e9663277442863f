"""The rows that a threshold decides: their numbers, and those next to the line.

Rows that are kept have their numbers in the clean tables. Rows that the stage rejected have them in
`rejected`, with what the other stages decide (kb.filters.thresholds).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from kb.core.sources import PUBLISHED, SOURCES
from kb.explore.tables import CurrentTables
from kb.explore.threshold_stages import StageOfTable
from kb.filters.predicates import number as shown
from kb.schema.tables import table
from kb.store.tables.reading import reading

EXAMPLES = 20  # on each side of the line
_LONGEST = 160  # characters of an example's text


@dataclass(frozen=True)
class NearRow:
    """A row near the line. `now` and `then` are its outcomes by the two thresholds."""

    key: str
    number: str
    text: str
    now: str
    then: str
    address: str
    is_local: bool


@dataclass(frozen=True)
class ThresholdRows:
    """The kept rows and those that the stage rejected.

    `numbers` has the columns number, kept, outcome (without this stage) and group; kept rows come
    first, in the order of their files, then those of `rejected`. `limit` is the threshold that the
    tables were filtered with. `is_outdated`: the rejected rows lack numbers.
    """

    stage: StageOfTable
    numbers: pa.Table
    kept: ds.FileSystemDataset
    rejected: pa.Table
    limit: float
    is_outdated: bool

    def passes(self, value: float) -> Any:
        """Which rows a threshold lets pass, as a mask; null without a number."""
        numbers = self.numbers["number"]
        at_least = self.stage.threshold.at_least
        return pc.greater_equal(numbers, value) if at_least else pc.less_equal(numbers, value)

    def nearest(self, value: float, *, inside: bool) -> Iterator[NearRow]:
        """The rows next to the line on one side of it, the nearest first. Raises DamagedData."""
        mask = pc.equal(self.passes(value), inside)
        numbers = pc.if_else(mask, self.numbers["number"], None)
        order = "ascending" if self.stage.threshold.at_least == inside else "descending"
        places = pc.select_k_unstable(
            pa.table({"number": numbers}), k=EXAMPLES, sort_keys=[("number", order)]
        )
        here = [place for place in places.to_pylist() if numbers[place].is_valid]
        kept = self._kept(place for place in here if place < self._size)
        for place in here:
            if place < self._size:
                key, text = kept[place]
            else:
                row = self.rejected.slice(place - self._size, 1).to_pylist()[0]
                key, text = row["key"], row["title"]
            outcome = self.numbers["outcome"][place].as_py()
            is_kept = place < self._size
            yield NearRow(
                key.removeprefix(self.stage.chain.prefix),
                shown(numbers[place].as_py()),
                (text or "")[:_LONGEST],
                "kept" if is_kept else "rejected",
                outcome if inside else "rejected",
                self._address(key, is_kept),
                is_kept,
            )

    @property
    def _size(self) -> int:
        """How many rows are kept."""
        return self.numbers.num_rows - self.rejected.num_rows

    def _kept(self, places: Iterable[int]) -> Mapping[int, tuple[str, str]]:
        """Key and text (the title, else the body) of kept rows by place."""
        ordered = sorted(places)
        key = table(self.stage.chain.table).key[0]
        text = next((one for one in ("title", "body") if one in self.kept.schema.names), key)
        with reading(self.kept.files):
            taken = self.kept.scanner(columns=[key, text]).take(pa.array(ordered, pa.int64()))
        rows = zip(ordered, taken[key].to_pylist(), taken[text].to_pylist(), strict=True)
        return {
            place: (f"{self.stage.chain.prefix}{name}", str(body or ""))
            for place, name, body in rows
        }

    def _address(self, key: str, is_kept: bool) -> str:
        """The page with what surrounds a kept row; the address of a rejected item at its source,
        "" where the key alone does not give one.
        """
        source = self.stage.source
        if not SOURCES[source].ref:
            return ""
        if is_kept:
            return f"/document?{urlencode({'ref': f'{source}:{key}'})}"
        bare = key.removeprefix(self.stage.chain.prefix)
        is_main = self.stage.table == PUBLISHED[source].main
        return SOURCES[source].address(bare) if is_main else ""


def rows_of(tables: CurrentTables, stage: StageOfTable) -> ThresholdRows:
    """The rows of a stage as they are now. Raises DamagedData."""
    threshold, files = stage.threshold, tables.view(stage.view).files
    with reading(files):
        kept = ds.dataset([str(path) for path in files], format="parquet")
        group = [stage.group] if stage.group in kept.schema.names else []
        rows = kept.to_table(columns=[*sorted(threshold.reads), *group])
    is_outdated = stage.rejected in tables and "number" not in tables.columns(stage.rejected)
    rejected = _rejected(tables, stage) if not is_outdated else _NONE
    numbers = pa.table(
        {
            "number": threshold.numbers(rows),
            "kept": pa.repeat(True, rows.num_rows),
            "outcome": pa.repeat("kept", rows.num_rows),
            "group": rows[stage.group] if group else pa.nulls(rows.num_rows, pa.string()),
        }
    )
    numbers = pa.concat_tables(
        [numbers, rejected.select(numbers.column_names)], promote_options="permissive"
    )
    limit = float(rejected["threshold"][0].as_py()) if rejected.num_rows else threshold.limit
    return ThresholdRows(stage, numbers, kept, rejected, limit, is_outdated)


_TEXTS = ("key", "title", "outcome", "group", "threshold")
_NONE = pa.table(
    {
        **{name: pa.array([], pa.string()) for name in _TEXTS},
        "number": pa.array([], pa.float64()),
        "kept": pa.array([], pa.bool_()),
    }
)


def _rejected(tables: CurrentTables, stage: StageOfTable) -> pa.Table:
    if stage.rejected not in tables:
        return _NONE
    return tables.rows(
        stage.rejected,
        f"""SELECT key, title, number, false AS kept, other_stages::VARCHAR AS outcome,
            {stage.group or "NULL"}::VARCHAR AS "group", threshold::VARCHAR AS threshold
        FROM {{table}} WHERE stage = ? AND starts_with(key, ?) AND number IS NOT NULL
        ORDER BY key""",
        [stage.threshold.stage, stage.chain.prefix],
    )
