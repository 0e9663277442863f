"""What the figures show, aggregated by DuckDB over clean/, rejected/, pairs/ and the ledgers.

Only aggregates and a few sample rows are held in memory, whatever the size of the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.schema import table
from kb.store import database
from kb.store.reading import reading, scan, state

if TYPE_CHECKING:
    from kb.core.context import Run

# The contract's stages in their order; a stage that is not named here comes last.
STAGES = {
    "youtube/videos": (
        "missing",
        "topic",
        "views",
        "aspect_ratio",
        "duration",
        "age_restricted",
        "toxicity",
        "transcript",
    ),
    "wiki/pages": ("missing", "robots", "render", "words", "toxicity"),
    "reddit/posts": ("missing", "removed", "nsfw", "score", "toxicity"),
    "reddit/comments": ("missing", "post", "removed", "toxicity"),
}
FULL_NAMES = {"reddit/posts": "t3_", "reddit/comments": "t1_"}  # one rejected table holds both


@dataclass(frozen=True)
class Funnel:
    """How many rows came in, what each stage dropped, and what was left."""

    name: str
    crawled: int
    dropped: tuple[tuple[str, int], ...]
    failed: int
    pending: int
    kept: int


class Data:
    """The data root through one DuckDB connection in memory."""

    def __init__(self, run: Run) -> None:
        self.root = run.root
        self.con = database.connect(run.root, threads=max(1, run.workers))

    def __enter__(self) -> Data:
        return self

    def __exit__(self, *failure: object) -> None:
        self.con.close()

    def files(self, name: str) -> list[str]:
        """The clean files of a table ("youtube/videos", "pairs/pairs"), or of "youtube/rejected"."""
        folder = self.root / "pairs" if name == "pairs/pairs" else self.root / "clean" / name
        return [
            str(path) for path in sorted(folder.glob("*.parquet")) if not path.name.startswith(".")
        ]

    def rows(self, name: str, sql: str, *values: object) -> list[tuple[Any, ...]]:
        """Rows of a query in which {t} stands for the table; nothing when there are no files. Raises DamagedData."""
        files = self.files(name)
        if not files:
            return []
        with reading(files):
            return self.con.execute(sql.replace("{t}", scan(files)), list(values)).fetchall()

    def count(self, name: str) -> int:
        """Rows of a table."""
        found = self.rows(name, "SELECT count(*) FROM {t}")
        return int(found[0][0]) if found else 0

    def quantile(self, name: str, column: str, share: float) -> float | None:
        """The value below which that share of the rows lies."""
        found = self.rows(
            name,
            f'SELECT quantile_disc("{column}", ?) FROM {{t}} WHERE "{column}" IS NOT NULL',
            share,
        )
        return None if not found or found[0][0] is None else float(found[0][0])

    def histogram(self, name: str, column: str, edges: Sequence[float]) -> list[int]:
        """Rows between neighbouring edges; the last bin has its upper edge in it."""
        tests = [
            f'count(*) FILTER ("{column}" >= {low!r} AND "{column}" {"<=" if last else "<"} {high!r})'
            for low, high, last in zip(
                edges[:-1], edges[1:], [False] * (len(edges) - 2) + [True], strict=True
            )
        ]
        found = self.rows(name, f"SELECT {', '.join(tests)} FROM {{t}}")
        return [int(n) for n in found[0]] if found else []

    def top(self, name: str, column: str, n: int) -> list[tuple[str, int]]:
        """The most frequent values."""
        return self.rows(
            name,
            f'SELECT "{column}"::VARCHAR, count(*) AS n FROM {{t}} WHERE "{column}" IS NOT NULL GROUP BY 1 ORDER BY n DESC, 1 LIMIT {n}',
        )

    def funnel(self, name: str) -> Funnel | None:
        """The stages of a table, None when nothing was filtered."""
        source = name.partition("/")[0]
        prefix = FULL_NAMES.get(name, "")
        dropped, failed, pending = (
            self._verdicts(source, kind, prefix) for kind in ("rejected", "failed", "pending")
        )
        kept = self.count(name)
        if not (kept or dropped or failed or pending):
            return None
        order = STAGES.get(name, ())
        stages = [(stage, dropped.get(stage, 0)) for stage in order] + sorted(
            (stage, n) for stage, n in dropped.items() if stage not in order
        )
        crawled = kept + sum(dropped.values()) + sum(failed.values()) + sum(pending.values())
        return Funnel(
            name, crawled, tuple(stages), sum(failed.values()), sum(pending.values()), kept
        )

    def _verdicts(self, source: str, kind: str, prefix: str) -> dict[str, int]:
        column = "stage" if kind == "rejected" else "reason"
        where = f"WHERE starts_with(key, '{prefix}')" if prefix else ""
        return dict(
            self.rows(
                f"{source}/{kind}", f"SELECT {column}, count(*) FROM {{t}} {where} GROUP BY 1"
            )
        )

    def ledgers(self) -> list[tuple[str, str, str, int, int]]:
        """(source, day, bucket, requests, units) of every source that keeps a ledger, by day."""
        found: dict[tuple[str, str, str], list[int]] = {}
        for path in sorted((self.root / "state").glob("*.sqlite")):
            with state(path) as frontier:
                for day, bucket, _, requests, units in frontier.ledger():
                    entry = found.setdefault((path.stem, day, bucket), [0, 0])
                    entry[0] += requests
                    entry[1] += units or 0
        return [(*key, *sums) for key, sums in sorted(found.items())]

    def words(
        self, name: str, columns: Sequence[str], stop: set[str], n: int
    ) -> list[tuple[str, int]]:
        """The most frequent words of some columns, in lower case, with how many rows say them."""
        text = " || ' ' || ".join(f"coalesce(\"{column}\", '')" for column in columns)
        plain = f"lower(regexp_replace({text}, 'https?://\\S+', ' ', 'g'))"
        word = "[a-z][a-z''’-]+[a-z]"
        found = self.rows(
            name,
            f"SELECT w, count(*) AS n FROM (SELECT unnest(list_distinct(regexp_extract_all({plain}, '{word}'))) AS w"
            f" FROM {{t}}) GROUP BY 1 ORDER BY n DESC, w LIMIT {n + len(stop)}",
        )
        return [(word, count) for word, count in found if word not in stop][:n]

    def newest(self) -> str:
        """The newest time at which anything was read, as text; empty when unknown."""
        names = ("youtube/videos", "wiki/pages", "reddit/posts", "reddit/comments")
        moments = [
            row[0]
            for name in names
            if self.files(name)
            for row in self.rows(
                name,
                "SELECT strftime(max(fetched_at AT TIME ZONE 'UTC'), '%Y-%m-%d %H:%M UTC') FROM {t}",
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

    def path(self, relative: str) -> Path:
        """A file that a clean table names."""
        return self.root / relative
