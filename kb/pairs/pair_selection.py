"""The pairs that a command is asked for, as SQL over pairs, quality, scores and labels."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

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
    named = {word.lower() for word in re.findall(r"\w+", re.sub(r"'[^']*'", "", where))}
    of_films = within_shot or aligned is not None or not named.isdisjoint(FIGURES)
    files = _PairFiles(
        catalog.files("pairs/pairs"),
        catalog.files("pairs/quality"),
        [] if named.isdisjoint(SCORES) else catalog.files("pairs/scores"),
        catalog.files("films/film_figures") if of_films else [],
        catalog.files("labels/labels"),
    )
    if not files.pairs:
        raise FatalError("there are no pairs", hint="run `kb pairs` first, or --data a release")
    _require_columns(files, named)
    asked = _joined(files)
    if given is not None:
        asked = _listed_in(given, asked)
    asked = f"SELECT * FROM ({asked}) WHERE ({where or 'true'})"
    if within_shot:
        asked = _within_shots(asked, files.figures)
    if aligned is not None:
        asked = _at_aligned_times(asked, aligned, files.figures)
    return asked


class _PairFiles(NamedTuple):
    """Parquet files by table; none of a table that is not there or not needed."""

    pairs: list[Path]
    quality: list[Path]
    scores: list[Path]
    figures: list[Path]
    labels: list[Path]


def _require_columns(files: _PairFiles, named: set[str]) -> None:
    """Raise UsageError where a condition names a column whose table is not there."""
    of_films = [*files.scores, *files.figures]
    for columns, there, made_by in (
        ((*SCORES, *FIGURES), of_films, "kb pairs score --videos DIR"),
        (LABELS, files.labels, "kb label import FILE"),
    ):
        for name in columns:
            if not there and name in named:
                what = f"--where names {name}, which this data root does not have"
                raise UsageError(what, hint=f"run `{made_by}` first")


def _joined(files: _PairFiles) -> str:
    """SQL of pairs with the columns of the other tables, each column once."""
    parquet.verify_files(*chain.from_iterable(files))
    known = set(parquet.names(files.pairs[0]))
    columns, joins = ["p.*"], [f"{scan(files.pairs)} AS p"]
    if "text" not in known:
        columns.append("NULL::VARCHAR AS text")
    for alias, others in (("q", files.quality), ("s", files.scores), ("f", files.figures)):
        if others:
            theirs = parquet.names(others[0])
            both = ", ".join(name for name in theirs if name in known)
            columns.append(f"{alias}.* EXCLUDE ({both})")
            joins.append(f"LEFT JOIN {scan(others)} AS {alias} ON {alias}.pair_id = p.pair_id")
            known.update(theirs)
    if files.labels:
        columns.append("l.* EXCLUDE (item_id)")
        joins.append(f"LEFT JOIN ({_answers(files.labels)}) AS l ON l.item_id = p.pair_id")
    return f"SELECT {', '.join(columns)} FROM {' '.join(joins)}"


def _answers(labels: list[Path]) -> str:
    """SQL of what most people answered of each pair, of equals the last by the alphabet."""
    answers = ", ".join(
        f"max({{'n': n, 'a': answer}}) FILTER (question = '{question}')['a'] AS {question}"
        for question in LABELS
    )
    return (
        f"SELECT item_id, {answers} FROM (SELECT item_id, question, answer, count(*) AS n"
        f" FROM {scan(labels)} WHERE kind = 'pair' GROUP BY ALL) GROUP BY item_id"
    )


def _listed_in(given: Path, asked: str) -> str:
    """SQL of the pairs that a file lists, and of its column `split` where it has one."""
    split = ", g.split" if "split" in parquet.names(with_ids(given)) else ""
    parquet.verify_files(given)
    listed = f"JOIN {scan([given])} AS g ON g.pair_id = a.pair_id"
    return f"SELECT a.*{split} FROM ({asked}) AS a {listed}"


def _within_shots(asked: str, figures: list[Path]) -> str:
    """SQL of the pairs whose film was seen, with the stretch without a cut as the clip."""
    if not figures:
        raise UsageError(
            "no film was seen yet, so it is not known where its cuts are",
            hint="run `kb pairs score --videos DIR` first",
        )
    return (
        "SELECT * REPLACE (cut_free_start_s AS clip_start_s, cut_free_end_s AS clip_end_s)"
        f" FROM ({asked}) WHERE cuts IS NOT NULL"
    )


def _at_aligned_times(asked: str, least: float, figures: list[Path]) -> str:
    """SQL of the pairs with aligned times as the clip where `alignable` is at least so much."""
    if not (figures and _is_aligned(figures)):
        raise UsageError("no pair is aligned with its film yet", hint="run `kb pairs align` first")
    start, end = (
        f"CASE WHEN alignable >= {least!r} THEN aligned_{side}_s END AS clip_{side}_s"
        for side in ("start", "end")
    )
    return f"SELECT * REPLACE ({start}, {end}) FROM ({asked})"


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
