"""The pairs that a command is asked for, as SQL over pairs, quality, scores and labels."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import duckdb

from kb.core.errors import DamagedData, FatalError, UsageError
from kb.store.exhausted import is_out_of_memory
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

if TYPE_CHECKING:
    from kb.artifacts.table_catalog import Catalog

SCORES = ("model", "similarity", "margin", "best_offset_s", "static_share", "frames")
ALIGNED = ("aligned_start_s", "aligned_end_s", "alignable")
FIGURES = (
    *("cuts", "cut_free_start_s", "cut_free_end_s", "motion", "static_share", "dark_share"),
    *ALIGNED,
    "visual_duplicate_of",
)
LABELS = ("visible", "described", "on_time")  # questions about pairs


def asking(
    catalog: Catalog,
    given: Path | None = None,
    where: str = "",
    *,
    within_shot: bool = False,
    aligned: float | None = None,
) -> str:
    """SQL of all pairs, or of those in the file `given`, with every column that a condition may
    name: of pairs and quality, and where there are some of scores, films and labels. With
    `within_shot` those whose film was seen, and of each clip the stretch without a cut. With
    `aligned` clips have the times of `kb pairs align`, null where `alignable` is less or unknown.

    Raises UsageError where the condition names scores or labels that are not there, or no pair is
    aligned, FatalError without pairs.
    """
    files = catalog.files("pairs/pairs")
    if not files:
        raise FatalError("there are no pairs", hint="run `kb pairs` first, or --data a release")
    parquet.verify_files(*files)
    columns, joins = ["p.*"], [f"{scan(files)} AS p"]
    if "text" not in parquet.open_file(files[0]).schema_arrow.names:
        columns.append("NULL::VARCHAR AS text")
    if quality := catalog.files("pairs/quality"):
        columns.append(f"q.* EXCLUDE ({', '.join(_both(files[0], quality[0]))})")
        joins.append(f"LEFT JOIN {scan(quality)} AS q ON q.pair_id = p.pair_id")
    words = {word.lower() for word in re.findall(r"\w+", re.sub(r"'[^']*'", "", where))}
    scores = [] if words.isdisjoint(SCORES) else catalog.files("pairs/scores")
    if scores:
        columns.append(f"s.* EXCLUDE ({', '.join(_both(files[0], scores[0]))})")
        joins.append(f"LEFT JOIN {scan(scores)} AS s ON s.pair_id = p.pair_id")
    named = within_shot or aligned is not None or not words.isdisjoint(FIGURES)
    figures = catalog.files("films/film_figures") if named else []
    if figures:
        # The share of static frames is the same in both tables.
        known = {*_both(files[0], figures[0]), *(_both(scores[0], figures[0]) if scores else ())}
        columns.append(f"f.* EXCLUDE ({', '.join(sorted(known))})")
        joins.append(f"LEFT JOIN {scan(figures)} AS f ON f.pair_id = p.pair_id")
    labels = catalog.files("labels/labels")
    if labels:
        # What most people answered, of equals the last by the alphabet.
        answers = ", ".join(
            f"max({{'n': n, 'a': answer}}) FILTER (question = '{question}')['a'] AS {question}"
            for question in LABELS
        )
        columns.append("l.* EXCLUDE (item_id)")
        joins.append(
            f"LEFT JOIN (SELECT item_id, {answers} FROM (SELECT item_id, question, answer,"
            f" count(*) AS n FROM {scan(labels)} WHERE kind = 'pair' GROUP BY ALL)"
            " GROUP BY item_id) AS l ON l.item_id = p.pair_id"
        )
    for names, there, made_by in (
        (SCORES, [*scores, *figures], "kb pairs score --videos DIR"),
        (FIGURES, [*scores, *figures], "kb pairs score --videos DIR"),
        (LABELS, labels, "kb label import FILE"),
    ):
        for name in names:
            if not there and name in words:
                what = f"--where names {name}, which this data root does not have"
                raise UsageError(what, hint=f"run `{made_by}` first")
    asked = f"SELECT {', '.join(columns)} FROM {' '.join(joins)}"
    if given is not None:
        with_split = "split" in parquet.open_file(with_ids(given)).schema_arrow.names
        asked = (
            f"SELECT a.*{', g.split' if with_split else ''} FROM ({asked}) AS a"
            f" JOIN {scan([given])} AS g ON g.pair_id = a.pair_id"
        )
    if within_shot and not figures:
        raise UsageError(
            "no film was seen yet, so it is not known where its cuts are",
            hint="run `kb pairs score --videos DIR` first",
        )
    asked = f"SELECT * FROM ({asked}) WHERE ({where or 'true'})"
    if within_shot:
        asked = (
            "SELECT * REPLACE (cut_free_start_s AS clip_start_s, cut_free_end_s AS clip_end_s)"
            f" FROM ({asked}) WHERE cuts IS NOT NULL"
        )
    if aligned is not None:
        if not (figures and _is_aligned(figures)):
            raise UsageError(
                "no pair is aligned with its film yet", hint="run `kb pairs align` first"
            )
        start, end = (
            f"CASE WHEN alignable >= {aligned!r} THEN aligned_{side}_s END AS clip_{side}_s"
            for side in ("start", "end")
        )
        asked = f"SELECT * REPLACE ({start}, {end}) FROM ({asked})"
    return asked


def _is_aligned(figures: list[Path]) -> bool:
    """Whether a pair has aligned times."""
    with reading(figures), database.asking() as con:
        return bool(
            con.execute(f"SELECT count(alignable) > 0 FROM {scan(figures)}").fetchall()[0][0]
        )


def with_ids(given: Path) -> Path:
    """The file, if it has the ids of pairs. Raises UsageError."""
    try:
        if "pair_id" in parquet.names(given):
            return given
    except DamagedData:
        pass
    raise UsageError(
        f"--pairs {given} is not a Parquet file with a column pair_id",
        hint="give pairs.parquet of `kb pairs draw`",
    )


def checked(con: duckdb.DuckDBPyConnection, asked: str, where: str) -> str:
    """The SQL of `asking`. Raises UsageError for a condition that DuckDB does not understand."""
    try:
        if len(con.extract_statements(asked)) != 1:
            raise duckdb.ParserException("it is more than a condition")
        con.sql(asked)
    except duckdb.Error as error:
        if is_out_of_memory(error):
            raise
        raise UsageError(
            f"--where {where!r} is not a valid condition: {database.one_line(error)}",
            hint="write a condition on the columns of pairs and quality, such as language = 'en'",
        ) from None
    return asked


def _both(first: Path, other: Path) -> list[str]:
    """The columns that two files have."""
    mine, theirs = (parquet.open_file(path).schema_arrow.names for path in (first, other))
    return [name for name in theirs if name in mine]
