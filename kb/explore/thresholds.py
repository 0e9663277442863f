"""What another threshold would keep: figures, a histogram, and rows on both sides of the line.

The figures are those of a filter run with the other threshold. Nothing is written. Rows that are
kept have their numbers in the clean tables. Rows that the stage rejected have them in `rejected`,
with what the other stages decide (kb.filters.thresholds). Of films there are histograms alone: no
threshold of theirs ships.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import urlencode

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from kb.core.config.pipeline import recipe_of
from kb.core.config.profile import Profile
from kb.core.errors import SettingError, UsageError
from kb.core.sources import SOURCES
from kb.explore.conditions import Condition, fields
from kb.explore.histogram import Histogram, HistogramBar, draw, edges_of
from kb.explore.tables import CurrentTables
from kb.filters.chain import Chain
from kb.filters.predicates import number as shown
from kb.filters.thresholds import UNSCORED, StageThreshold, thresholds
from kb.look.headings import heading
from kb.schema.tables import table
from kb.store.tables import database
from kb.store.tables.reading import reading

GROUPS = 20
_WAITING = {
    "pending": "wait for the next crawl",
    UNSCORED: "wait for a toxicity score, which the next filter computes",
    "failed": "count as failed",
}


EXAMPLES = 20  # on each side of the line
_OF_FILMS = ("motion", "static_share", "dark_share")
_LONGEST = 160  # characters of an example's text


@dataclass(frozen=True)
class ThresholdFigures:
    """What a `value` keeps, instead of the `current` threshold of the stage: rows `kept` now, and
    of these and the rejected ones how many are `lost` and `won`.

    `waiting` are numbers of rejected rows that would then wait, with what for. `groups` are (name,
    rows lost, rows won). `outside` and `inside` are the rows next to the line.
    """

    stage: StageOfTable
    histogram: Histogram
    current: float
    value: float
    kept: int
    lost: int
    won: int
    waiting: list[tuple[int, str]]
    groups: list[tuple[str, int, int]]
    outside: list[dict[str, str]]
    inside: list[dict[str, str]]
    has_rejected: bool
    is_outdated: bool
    column: str

    def rows_address(self, bar: HistogramBar, part: str) -> str:
        """The page of the rows that a part of a bar stands for; "" where no column has their
        number.
        """
        stage = self.stage
        name = self.column if part == "kept" else "number"
        if not name:
            return ""
        tests = ("at least", "below") if stage.threshold.at_least else ("above", "at most")
        wanted = [
            Condition(name, test, f"{edge:.17g}")
            for test, edge in zip(tests, (bar.low, bar.high), strict=True)
        ]
        place = {"source": stage.source, "table": stage.table}
        if part != "kept":
            place |= {"verdict": "rejected", "stage": stage.threshold.stage}
            test = "is" if part == "others" else "is not"
            wanted.append(Condition("other_stages", test, "rejected"))
            if stage.chain.prefix:
                wanted.append(Condition("key", "contains", stage.chain.prefix))
        return f"/rows?{urlencode(place | fields(wanted))}"

    @property
    def plain_value(self) -> str:
        """The value as TOML and HTML write it."""
        value = self.value
        return str(int(value) if value == int(value) else value)

    @property
    def profile_line(self) -> str:
        """The line of the profile that sets the value, as `kb profile new` writes it; "" without a
        setting.
        """
        setting = self.stage.threshold.setting
        return f"{setting} = {self.plain_value}" if setting else ""


class FilmHistogram(NamedTuple):
    """How a column of film_figures is spread over pairs."""

    column: str
    histogram: Histogram

    @property
    def axis(self) -> str:
        """What its numbers are."""
        return heading("films/film_figures", self.column)

    def pairs_address(self, bar: HistogramBar) -> str:
        """The page of the pairs of a bar."""
        edges = (("above", bar.low), ("at most", bar.high))
        wanted = [Condition(self.column, test, f"{edge:.17g}") for test, edge in edges]
        return f"/pairs?{urlencode(fields(wanted))}"


@dataclass(frozen=True)
class ThresholdPage:
    """The stages that have a threshold, and the figures of one; None where no stage has. `films`
    are histograms, none before a film was seen.
    """

    stages: list[StageOfTable]
    figures: ThresholdFigures | None = None
    films: Sequence[FilmHistogram] = ()

    @property
    def same_setting(self) -> list[str]:
        """The other stages that the same key of the profile decides."""
        if self.figures is None or not self.figures.stage.threshold.setting:
            return []
        stage = self.figures.stage
        return [
            other.name
            for other in self.stages
            if other.threshold.setting == stage.threshold.setting and other.name != stage.name
        ]


def read(tables: CurrentTables, profile: Profile, query: Mapping[str, str]) -> ThresholdPage:
    """The page of an address: the first stage without one, its current threshold without a value.

    `step` is a position of the slider; `value` any number. Raises UsageError, DamagedData.
    """
    stages = list(stages_of(tables, profile))
    figures = _figures(tables, _chosen(stages, query), query) if stages else None
    return ThresholdPage(stages, figures, list(_of_films(tables)))


def _of_films(tables: CurrentTables) -> Iterator[FilmHistogram]:
    if "film_figures" not in tables:
        return
    for column in _OF_FILMS:
        numbers = tables.rows(
            "film_figures",
            f"SELECT {column} AS number, true AS kept, 'kept' AS outcome FROM {{table}}"
            f" WHERE {column} IS NOT NULL",
        )
        if not numbers.num_rows:
            continue
        with database.asking() as con:
            con.register("numbers", numbers)
            least = float(pc.min(numbers["number"]).as_py())
            edges = edges_of(con, least, at_least=False)
            yield FilmHistogram(column, draw(con, edges, least, least, at_least=False))


def _chosen(stages: list[StageOfTable], query: Mapping[str, str]) -> StageOfTable:
    asked = [(name, query[name]) for name in ("source", "table", "stage") if query.get(name)]
    for stage in stages:
        known = {"source": stage.source, "table": stage.table, "stage": stage.threshold.stage}
        if all(known[name] == value for name, value in asked):
            return stage
    given = " ".join(value for _, value in asked)
    raise UsageError(f"there is no threshold of {given!r}")


def _figures(
    tables: CurrentTables, stage: StageOfTable, query: Mapping[str, str]
) -> ThresholdFigures:
    rows = rows_of(tables, stage)
    at_least = stage.threshold.at_least
    with database.asking() as con:
        con.register("numbers", rows.numbers)
        edges = edges_of(con, rows.limit, at_least)
        value = _value(query, edges, rows.limit)
        con.register("judged", rows.numbers.append_column("passes", rows.passes(value)))
        lost, won = "kept AND NOT passes", "NOT kept AND outcome = 'kept' AND passes"
        kept, n_lost, n_won = con.execute(
            f"SELECT count(*) FILTER (kept), count(*) FILTER ({lost}), count(*) FILTER ({won})"
            " FROM judged"
        ).fetchall()[0]
        waiting = con.execute(
            "SELECT count(*), outcome FROM judged WHERE NOT kept AND passes GROUP BY 2 ORDER BY 2"
        ).fetchall()
        groups = con.execute(
            f"""SELECT "group", count(*) FILTER ({lost}) AS lost, count(*) FILTER ({won}) AS won
            FROM judged WHERE "group" IS NOT NULL GROUP BY 1 HAVING lost + won > 0
            ORDER BY lost + won DESC, 1 LIMIT {GROUPS}"""
        ).fetchall()
        histogram = draw(con, edges, rows.limit, value, at_least)
    return ThresholdFigures(
        stage,
        histogram,
        rows.limit,
        value,
        kept,
        n_lost,
        n_won,
        [(n, _WAITING[outcome]) for n, outcome in waiting if outcome in _WAITING],
        groups,
        list(rows.nearest(value, inside=False)),
        list(rows.nearest(value, inside=True)),
        stage.rejected in tables,
        rows.is_outdated,
        rows.column,
    )


def _value(query: Mapping[str, str], edges: list[float], current: float) -> float:
    try:
        if step := query.get("step"):
            return edges[min(max(int(step), 0), len(edges) - 1)]
        value = float(query.get("value") or current)
        if math.isfinite(value):
            return value
    except ValueError:
        pass
    given = query.get("step") or query.get("value")
    raise UsageError(f"the threshold is {given!r}, not a number")


class StageOfTable(NamedTuple):
    """A stage with a threshold, and the table whose rows it judges. Rows of the tables `followers`
    are kept only with their row of this one.
    """

    source: str
    table: str
    threshold: StageThreshold
    chain: Chain
    followers: tuple[str, ...]

    @property
    def name(self) -> str:
        """How pages call it: "youtube videos: views"."""
        return f"{self.source} {self.table}: {self.threshold.stage}"

    @property
    def view(self) -> str:
        """The bare name of the table."""
        return f"{self.source}_{self.table}"

    @property
    def rejected(self) -> str:
        """The bare name of the table with the rejected rows."""
        return f"{self.source}_rejected"

    @property
    def address(self) -> str:
        """The address of its page."""
        named = {"source": self.source, "table": self.table, "stage": self.threshold.stage}
        return f"/thresholds?{urlencode(named)}"

    @property
    def sign(self) -> str:
        """How a number compares with the limit in a row that passes."""
        return "≥" if self.threshold.at_least else "≤"

    @property
    def axis(self) -> str:
        """What its numbers are, with their unit."""
        reads = sorted(self.threshold.reads)
        if len(reads) == 1:
            return heading(f"{self.source}/{self.table}", reads[0])
        return self.threshold.stage.replace("_", " ").capitalize()

    @property
    def group(self) -> str:
        """The column by which changes are counted: the channel of videos, the type of posts."""
        named = [name for name in ("channel_title", "type") if name in self.chain.described.columns]
        return named[0] if named else ""


def stages_of(tables: CurrentTables, profile: Profile) -> Iterator[StageOfTable]:
    """The stages whose columns the tables have; none of a recipe that may not run. Raises
    DamagedData.
    """
    for source in SOURCES:
        if getattr(profile, source, None) is None:
            continue
        try:
            clean = recipe_of(profile, source).defined("clean")(profile)
        except SettingError:
            continue
        following = tuple(chain.table.partition("/")[2] for chain in clean.chains if chain.relate)
        for chain in clean.chains:
            table = chain.table.partition("/")[2]
            if f"{source}_{table}" not in tables:
                continue
            columns = tables.columns(f"{source}_{table}")
            for threshold in thresholds(chain.stages):
                if threshold.reads <= columns:
                    followers = () if chain.relate else following
                    yield StageOfTable(source, table, threshold, chain, followers)


@dataclass(frozen=True)
class ThresholdRows:
    """The kept rows and those that the stage rejected.

    `numbers` has the columns number, kept, outcome (without this stage) and group; kept rows come
    first, in the order of their files, then those of `rejected`. `limit` is the threshold that the
    tables were filtered with. `is_outdated`: the rejected rows lack numbers. `column` of the table
    has the numbers of kept rows, "" where they are made of several.
    """

    stage: StageOfTable
    numbers: pa.Table
    kept: ds.FileSystemDataset
    rejected: pa.Table
    limit: float
    is_outdated: bool
    column: str

    def passes(self, value: float) -> Any:
        """Which rows a threshold lets pass, as a mask; null without a number."""
        numbers = self.numbers["number"]
        at_least = self.stage.threshold.at_least
        return pc.greater_equal(numbers, value) if at_least else pc.less_equal(numbers, value)

    def nearest(self, value: float, *, inside: bool) -> Iterator[dict[str, str]]:
        """The rows next to the line on one side of it, the nearest first: key, number, text,
        address, and the outcomes `now` and `then` by the two thresholds. Raises DamagedData.
        """
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
                key, text = row["key"], row["title"] or row["text"]
            outcome = self.numbers["outcome"][place].as_py()
            is_kept = place < self._size
            yield {
                "key": key.removeprefix(self.stage.chain.prefix),
                "number": shown(numbers[place].as_py()),
                "text": (text or "")[:_LONGEST],
                "now": "kept" if is_kept else "rejected",
                "then": outcome if inside else "rejected",
                "address": self._address(key),
            }

    @property
    def _size(self) -> int:
        return self.numbers.num_rows - self.rejected.num_rows

    def _kept(self, places: Iterable[int]) -> Mapping[int, tuple[str, str]]:
        """Key and text (the title, else the body) of kept rows by place."""
        ordered = sorted(places)
        key = table(self.stage.chain.table).key[0]
        text = next((name for name in ("title", "body") if name in self.kept.schema.names), key)
        with reading(self.kept.files):
            taken = self.kept.scanner(columns=[key, text]).take(pa.array(ordered, pa.int64()))
        rows = zip(ordered, taken[key].to_pylist(), taken[text].to_pylist(), strict=True)
        return {
            place: (f"{self.stage.chain.prefix}{name}", str(body or ""))
            for place, name, body in rows
        }

    def _address(self, key: str) -> str:
        """The row's own page, kept or not."""
        source = self.stage.source
        return f"/document?{urlencode({'ref': f'{source}:{key}'})}" if SOURCES[source].ref else ""


def rows_of(tables: CurrentTables, stage: StageOfTable) -> ThresholdRows:
    """The rows of a stage as they are now. Raises DamagedData."""
    threshold, files = stage.threshold, tables.view(stage.view).files
    with reading(files):
        kept = ds.dataset([str(path) for path in files], format="parquet")
        group = [stage.group] if stage.group in kept.schema.names else []
        rows = kept.to_table(columns=[*sorted(threshold.reads), *group])
    is_outdated = stage.rejected in tables and "number" not in tables.columns(stage.rejected)
    rejected = _rejected(tables, stage) if not is_outdated else _NONE
    found = threshold.numbers(rows)
    numbers = pa.table(
        {
            "number": found,
            "kept": pa.repeat(True, rows.num_rows),
            "outcome": pa.repeat("kept", rows.num_rows),
            "group": rows[stage.group] if group else pa.nulls(rows.num_rows, pa.string()),
        }
    )
    numbers = pa.concat_tables(
        [numbers, rejected.select(numbers.column_names)], promote_options="permissive"
    )
    column = next((name for name in threshold.reads if _holds(rows[name], found)), "")
    limit = float(rejected["threshold"][0].as_py()) if rejected.num_rows else threshold.limit
    return ThresholdRows(stage, numbers, kept, rejected, limit, is_outdated, column)


def _holds(values: pa.ChunkedArray[Any], numbers: pa.Array[Any]) -> bool:
    """Whether a column has the very numbers that a stage compares."""
    is_number = pa.types.is_integer(values.type) or pa.types.is_floating(values.type)
    return is_number and bool(pc.all(pc.equal(values.cast(pa.float64()), numbers)).as_py())


_TEXTS = ("key", "title", "text", "outcome", "group", "threshold")

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
    text = "text" if "text" in tables.columns(stage.rejected) else "NULL"
    return tables.rows(
        stage.rejected,
        f"""SELECT key, title, {text}::VARCHAR AS text, number, false AS kept,
            other_stages::VARCHAR AS outcome,
            {stage.group or "NULL"}::VARCHAR AS "group", threshold::VARCHAR AS threshold
        FROM {{table}} WHERE stage = ? AND starts_with(key, ?) AND number IS NOT NULL
        ORDER BY key""",
        [stage.threshold.stage, stage.chain.prefix],
    )
