"""What the figures show, aggregated by DuckDB over the tables of a data root or a download, and
over the ledgers.

Only aggregates and a few sample rows are held in memory, whatever the size of the data.
"""

import itertools
from collections.abc import Sequence
from typing import Any, Self

import pyarrow as pa

from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.summary import remaining
from kb.look.headings import reading as in_words
from kb.schema import table, tables
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan, state

_PERIODS = 72
_STEPS = {"day": "%Y-%m-%d", "month": "%Y-%m", "year": "%Y", "decade": "%Ys", "century": "%Y"}


def _prefix(name: str) -> str:
    """What keys of a table begin with in the rejected table of its source, which holds them all."""
    source, _, short = name.partition("/")
    return SOURCES[source].tables.get(short, "")


class ReportData:
    """The data root through one DuckDB connection in memory."""

    def __init__(self, run: Run, *, clouds: bool = True) -> None:
        self.root, self.clouds = run.root, clouds  # whether word clouds are drawn
        self.catalog = Catalog(run.root.absolute())
        self.con = database.connect(self.catalog.spill, threads=max(1, run.workers))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        self.con.close()

    def files(self, name: str) -> list[str]:
        """The files of a table ("youtube/videos", "pairs/pairs", "youtube/rejected"): the clean
        ones, else the restored, else the released.
        """
        return [str(path) for path in self.catalog.files(name)]

    def rows(self, name: str, sql: str, *values: object) -> list[tuple[Any, ...]]:
        """Rows of a query in which {t} stands for the table; nothing when there are no files.

        Raises DamagedData.
        """
        files = self.files(name)
        if not files:
            return []
        with reading(files):
            parquet.verify_files(*files)
            rows = self._filled(name, files)
            return self.con.execute(sql.replace("{t}", rows), list(values)).fetchall()

    def _filled(self, name: str, files: list[str]) -> str:
        """SQL for the rows of a table, with nulls for declared columns that a release lacks."""
        source, _, short = name.partition("/")
        declared = table(name if name in tables() else f"shared/{short}").arrow()
        there = set(parquet.names(files[0]))
        lacking = [field for field in declared if field.name not in there]
        if not lacking:
            return scan(files)
        view = f"lacking_{source}_{short}"
        self.con.register(view, pa.schema(lacking).empty_table())
        return f"(SELECT * FROM {scan(files)} UNION ALL BY NAME SELECT * FROM {view})"

    def count(self, name: str) -> int:
        """Rows of a table."""
        rows = self.rows(name, "SELECT count(*) FROM {t}")
        return int(rows[0][0]) if rows else 0

    def total(self, name: str, sum: str) -> float | None:
        """An SQL aggregate over a table; None where there is nothing to add up."""
        rows = self.rows(name, f"SELECT {sum} FROM {{t}}")
        return None if not rows or rows[0][0] is None else float(rows[0][0])

    def quantile(self, name: str, column: str, share: float) -> float | None:
        """The value below which that share of the rows lies."""
        rows = self.rows(
            name,
            f'SELECT quantile_disc("{column}", ?) FROM {{t}} WHERE "{column}" IS NOT NULL',
            share,
        )
        return None if not rows or rows[0][0] is None else float(rows[0][0])

    def histogram(self, name: str, value: str, edges: Sequence[float]) -> list[int]:
        """Rows with a value, an SQL expression, between neighbouring edges.

        The last bin includes its upper edge.
        """
        tests = [
            f"count(*) FILTER (v >= {low!r} AND v {'<=' if high == edges[-1] else '<'} {high!r})"
            for low, high in itertools.pairwise(edges)
        ]
        rows = self.rows(name, f"SELECT {', '.join(tests)} FROM (SELECT {value} AS v FROM {{t}})")
        return [int(n) for n in rows[0]] if rows else [0] * len(tests)

    def top(self, name: str, column: str, n: int) -> list[tuple[str, int]]:
        return self.rows(
            name,
            f'SELECT "{column}"::VARCHAR, count(*) AS n FROM {{t}} WHERE "{column}" IS NOT NULL'
            f" GROUP BY 1 ORDER BY n DESC, 1 LIMIT {n}",
        )

    def timeline(self, name: str, column: str) -> tuple[str, list[tuple[str, int]]] | None:
        """(step, [(period, rows)]) in UTC, empty periods too; None when no row has a time.

        The step is the shortest of day, month, year, decade, century that gives few bars.
        """
        moment = f"\"{column}\" AT TIME ZONE 'UTC'"
        counted = ", ".join(f"date_diff('{step}', min(t), max(t))" for step in _STEPS)
        spans = self.rows(name, f"SELECT {counted} FROM (SELECT {moment} AS t FROM {{t}})")
        if not spans or spans[0][0] is None:
            return None
        lengths = zip(_STEPS, spans[0], strict=True)
        step = next((step for step, n in lengths if n < _PERIODS), "century")
        rows = self.rows(
            name,
            f"WITH d AS (SELECT date_trunc('{step}', {moment})::TIMESTAMP AS p, count(*) AS n"
            f' FROM {{t}} WHERE "{column}" IS NOT NULL GROUP BY 1), s AS (SELECT unnest('
            "generate_series((SELECT min(p) FROM d), (SELECT max(p) FROM d),"
            f" INTERVAL 1 {step})) AS p) SELECT strftime(s.p, '{_STEPS[step]}'), coalesce(n, 0)"
            " FROM s LEFT JOIN d USING (p) ORDER BY s.p",
        )
        return step, rows

    def dropped_scores(self, name: str, edges: Sequence[float]) -> list[int]:
        """Rows that the toxicity stage dropped, by the score that it dropped them for."""
        where = f"stage = 'toxicity' AND starts_with(key, '{_prefix(name)}')"
        value = f"CASE WHEN {where} THEN TRY_CAST(value AS FLOAT) END"
        return self.histogram(f"{name.partition('/')[0]}/rejected", value, edges)

    def funnel(self, name: str) -> list[tuple[str, int, int]]:
        """(step, rows left, rows dropped) from "crawled" to "kept"; [] if nothing was filtered."""
        source = name.partition("/")[0]
        prefix = _prefix(name)
        dropped, failed, pending = (
            dict(
                self.rows(
                    f"{source}/{kind}",
                    f"SELECT {column}, count(*) FROM {{t}}"
                    f" WHERE starts_with(key, '{prefix}') GROUP BY 1",
                )
            )
            for kind, column in (("rejected", "stage"), ("failed", "reason"), ("pending", "reason"))
        )
        kept = self.count(name)
        of, short = SOURCES[source], name.partition("/")[2]
        order = [stage for stage in of.stages if stage not in of.elsewhere.get(short, ())]
        stages = dict.fromkeys(order, 0) | dict(sorted(dropped.items()))
        steps = [(in_words("shared/rejected", "stage", stage), n) for stage, n in stages.items()]
        ends = {"failed": sum(failed.values()), "pending": sum(pending.values())}
        steps += [(end, n) for end, n in ends.items() if n]
        crawled = kept + sum(n for _, n in steps)
        return [*remaining(crawled, steps), ("kept", kept, 0)] if crawled else []

    def ledgers(self) -> list[tuple[str, str, str, int, int]]:
        """(source, day, bucket, requests, units) of every source that keeps a ledger, by day."""
        ledger: dict[tuple[str, str, str], list[int]] = {}
        for source in SOURCES:
            path = Layout(self.root).state(source)
            if not path.is_file():
                continue
            with state(path) as frontier:
                for day, bucket, _, requests, units in frontier.ledger():
                    entry = ledger.setdefault((source, day, bucket), [0, 0])
                    entry[0] += requests
                    entry[1] += units or 0
        return [(*key, sums[0], sums[1]) for key, sums in sorted(ledger.items())]

    def words(
        self, name: str, columns: Sequence[str], stop: set[str], n: int
    ) -> list[tuple[str, int]]:
        """The most frequent words of some columns, in lower case, with how many rows say them."""
        text = " || ' ' || ".join(f"coalesce(\"{column}\", '')" for column in columns)
        plain = f"lower(regexp_replace({text}, 'https?://\\S+', ' ', 'g'))"
        word = "[a-z][a-z''’-]+[a-z]"
        rows = self.rows(
            name,
            "SELECT w, count(*) AS n FROM (SELECT"
            f" unnest(list_distinct(regexp_extract_all({plain}, '{word}'))) AS w"
            f" FROM {{t}}) GROUP BY 1 ORDER BY n DESC, w LIMIT {n + len(stop)}",
        )
        return [(word, count) for word, count in rows if word not in stop][:n]

    def newest(self) -> str:
        """The newest time at which anything was read, as text; empty when unknown."""
        names = [f"{source}/{short}" for source, of in SOURCES.items() for short in of.tables]
        moments = [
            row[0]
            for name in names
            if self.files(name)
            for row in self.rows(
                name,
                "SELECT strftime(max(fetched_at AT TIME ZONE 'UTC'), '%Y-%m-%d %H:%M UTC')"
                " FROM {t}",
            )
            if row[0]
        ]
        return max(moments, default="")

    def samples(self, name: str, columns: Sequence[str], n: int) -> list[tuple[Any, ...]]:
        """Rows spread over a table by the MD5 of their key: the same ones each time."""
        key = table(name).key[0]
        # Times as text: DuckDB hands them out only where pytz is installed.
        shown = ", ".join(
            f"strftime(\"{column}\" AT TIME ZONE 'UTC', '%Y-%m-%d')"
            if table(name).column(column).type.startswith("timestamp")
            else f'"{column}"'
            for column in columns
        )
        return self.rows(
            name, f'SELECT {shown} FROM {{t}} ORDER BY md5("{key}"::VARCHAR), "{key}" LIMIT {n}'
        )
