"""annotations/<source>/: scores beside the rows, keyed by text hash, model, revision and precision.

Finished chunks appear as parts while a run goes on, so that a cut-off run scores nothing twice; at
its end they become one sorted file (kb.artifacts.score_files). A row that is in both for a moment
is the same row.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import purge_rows, score_files
from kb.artifacts.score_files import TABLE
from kb.schema.tables import table
from kb.store.artifact_registry import MANIFEST
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import write_table

CATEGORIES = (
    "toxicity",
    "severe_toxicity",
    "obscene",
    "threat",
    "insult",
    "identity_attack",
    "sexual_explicit",
)
PRECISIONS = ("fp32", "bf16", "int8")  # the exact one first
_SCORES: dict[str, pa.DataType] = dict.fromkeys(CATEGORIES, pa.float32())
_SCHEMA = pa.schema({**_SCORES, "precision": pa.string()})
_RANK = "CASE precision WHEN 'fp32' THEN 0 WHEN 'bf16' THEN 1 ELSE 2 END"


@dataclass(frozen=True)
class Scores:
    """The scores of one model under one data root. Small and picklable: workers get it as it is."""

    folder: str
    model: str
    revision: str

    def lookup(self, hashes: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Table:
        """A row for each hash, in order: `CATEGORIES` and `precision`; null where there is no score
        or no such class.

        Of several precisions the exact one wins, so the result doesn't depend on what was scored
        first. Raises DamagedData.
        """
        if isinstance(hashes, pa.ChunkedArray):
            hashes = hashes.combine_chunks()
        wanted = {"place": pa.array(range(len(hashes)), pa.int64()), "text_hash": hashes}
        names = ", ".join([*CATEGORIES, "precision"])
        with self._reading() as con:
            con.register("wanted", pa.table(wanted))
            rows: pa.Table = con.sql(
                f"SELECT {', '.join('s.' + name for name in [*CATEGORIES, 'precision'])}"
                f" FROM wanted w LEFT JOIN (  SELECT text_hash, {names} FROM {self._files()}"
                "  WHERE model = $model AND revision = $revision AND text_hash IN (SELECT text_hash"
                " FROM wanted)  QUALIFY row_number() OVER (PARTITION BY text_hash"
                f" ORDER BY {_RANK}) = 1) s USING (text_hash) ORDER BY w.place",
                params={"model": self.model, "revision": self.revision},
            ).to_arrow_table()
        return rows.cast(_SCHEMA)

    def missing(self, hashes: pa.Array[Any]) -> pa.Array[Any]:
        """True for each hash without a score; false for null."""
        return pc.and_(to_score(self.lookup(hashes)), pc.is_valid(hashes))

    def precisions(self) -> dict[str, int]:
        """How many texts have a score in each precision."""
        with self._reading() as con:
            rows = con.execute(
                f"SELECT precision, count(DISTINCT text_hash) FROM {self._files()}"
                " WHERE model = $model AND revision = $revision GROUP BY 1 ORDER BY 1",
                {"model": self.model, "revision": self.revision},
            ).fetchall()
        return dict(rows)

    def most_used(self) -> str:
        """`model@revision` of most scores, "" without scores."""
        with self._reading() as con:
            row = con.execute(
                f"SELECT model || '@' || revision FROM {self._files()} WHERE model IS NOT NULL"
                " GROUP BY ALL ORDER BY count(*) DESC, 1 LIMIT 1"
            ).fetchone()
        return str(row[0]) if row else ""

    def write(
        self,
        hashes: Sequence[str],
        scores: Sequence[Sequence[float]],
        precisions: Sequence[str],
        classes: Sequence[str],
    ) -> Path:
        """Add a chunk as the next part; a category that is not one of `classes` is null.

        Raises DiskFull.
        """
        place = [list(classes).index(name) if name in classes else None for name in CATEGORIES]
        columns: dict[str, Any] = {
            name: pa.array([None if n is None else row[n] for row in scores], pa.float32())
            for name, n in zip(CATEGORIES, place, strict=True)
        }
        columns["precision"] = pa.array(precisions, pa.string())
        return self.add_part(pa.array(hashes, pa.string()), pa.table(columns))

    def add_part(self, hashes: pa.Array[Any], scored: pa.Table) -> Path:
        """Add texts with their `CATEGORIES` and `precision` as the next part. Raises DiskFull."""
        rows = pa.table(
            {
                "text_hash": hashes,
                "model": pa.repeat(pa.scalar(self.model), len(hashes)),
                "revision": pa.repeat(pa.scalar(self.revision), len(hashes)),
                **{name: scored[name] for name in ("precision", *CATEGORIES)},
            }
        )
        folder = Path(self.folder)
        path = folder / f"part-{self._next():06d}.parquet"
        (folder / MANIFEST).unlink(missing_ok=True)  # it does not know the part
        write_table(path, rows, TABLE)
        return path

    @contextlib.contextmanager
    def _reading(self) -> Iterator[duckdb.DuckDBPyConnection]:
        """A connection for the files of scores. Raises DamagedData for one that can't be read."""
        files = parquet_files(Path(self.folder))
        with reading(files), database.over(files, Path(self.folder)) as con:
            yield con

    def _files(self) -> str:
        """SQL of all rows."""
        files = parquet_files(Path(self.folder))
        if files:
            parquet.verify_files(*files)
            return scan(files)
        columns = ", ".join(
            f"NULL::{'FLOAT' if column.type == 'float32' else 'VARCHAR'} AS {column.name}"
            for column in table(TABLE).columns
        )
        return f"(SELECT {columns} WHERE false)"

    def _next(self) -> int:
        numbers = [
            re.fullmatch(r"part-(\d+)\.parquet", path.name)
            for path in parquet_files(Path(self.folder), score_files.PARTS)
        ]
        return 1 + max((int(match.group(1)) for match in numbers if match), default=-1)


def to_score(
    known: pa.Table,
    threshold: float | None = None,
    reach: dict[str, float] | None = None,
    least: str | None = None,
) -> pa.Array[Any]:
    """True for each row of `Scores.lookup` without a score, or with a reduced one within reach of
    the threshold.

    `least`: a score of a lower precision than this one counts as none.
    """
    wanted = pc.is_null(known["precision"])
    if threshold is not None and reach:
        top = pc.max_element_wise(*(known[name] for name in CATEGORIES))
        for precision, distance in reach.items():
            if distance:
                near = pc.less_equal(
                    pc.abs(pc.subtract(top, pa.scalar(threshold, pa.float32()))),
                    pa.scalar(distance, pa.float32()),
                )
                wanted = pc.or_(
                    wanted,
                    pc.fill_null(pc.and_(pc.equal(known["precision"], precision), near), False),
                )
    for precision in PRECISIONS[PRECISIONS.index(least) + 1 :] if least else ():
        wanted = pc.or_(wanted, pc.fill_null(pc.equal(known["precision"], precision), False))
    return wanted.combine_chunks() if isinstance(wanted, pa.ChunkedArray) else wanted


def unscored(size: int) -> pa.Table:
    """What `Scores.lookup` gives of so many texts without a score."""
    return pa.table({field.name: pa.nulls(size, field.type) for field in _SCHEMA})


def drop_unused(root: Path, source: str, texts: Iterable[pa.Array[Any]]) -> int:
    """Forget the scores of a source's texts that are none of these; how many. Raises DiskFull."""
    if not Layout(root).annotations(source).is_dir():
        return 0
    used = pa.chunked_array([text_hashes(part) for part in texts], pa.string()).unique()
    return purge_rows.drop_annotations(root, source, used)


def text_hashes(texts: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """SHA-256 of each text's UTF-8 bytes, 64 hexadecimal digits.

    Null for a null or empty text, which has nothing to score.
    """
    sha256 = hashlib.sha256
    values = texts.cast(pa.binary()).to_pylist()
    return pa.array([sha256(value).hexdigest() if value else None for value in values], pa.string())
