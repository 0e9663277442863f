"""The gate's question whether every text was scored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import duckdb

from kb.artifacts.release_folder import ReleasedTable, ReleaseFolder
from kb.core.context import Run
from kb.core.sources import SOURCES, made_by
from kb.release.gate.problem import GateProblem, damaged
from kb.schema import Table, released_tables
from kb.store import database
from kb.store.layout import Layout


def check(run: Run, folder: ReleaseFolder, whole: list[ReleasedTable]) -> list[GateProblem]:
    """Every text that the source has must have been scored,
    in clean/ and as released; `toxicity_<text>` belongs to `<text>`.
    """
    shards = {part.table.name: part.shards for part in whole}
    problems = []
    for declared in released_tables(folder.source):
        where = f"{folder.source}/{declared.short}"
        clean = _unscored(Layout(run.root).rows(declared.name), declared, set(declared.names()))
        released = _unscored(
            shards.get(declared.name, ()), declared, set(declared.names(released=True))
        )
        if isinstance(clean, GateProblem):
            problems.append(clean)
            continue
        command = (
            f"run `kb {folder.source} filter` and `kb {folder.source} export` again"
            if run.profile.toxicity.on
            else "the release is incomplete, toxicity is off in the profile"
        )
        problems += [
            GateProblem(
                "toxicity", where, f"{rows:,} rows have no toxicity score of {text}; {command}"
            )
            for text, rows in clean.items()
        ]
        if not isinstance(released, GateProblem):
            problems += [
                GateProblem(
                    "toxicity",
                    where,
                    f"{rows:,} released rows have no toxicity score of {text};"
                    " run the export again",
                )
                for text, rows in released.items()
                if rows > clean.get(text, 0)
            ]
    return problems


def _unscored(
    files: Sequence[Path], declared: Table, names: set[str]
) -> dict[str, int] | GateProblem:
    """Text → rows with that text and without its score."""
    # Each text → what says whether it is there, and its score.
    tests = {
        name.removeprefix("toxicity_"): (
            f'length(trim("{name.removeprefix("toxicity_")}")) > 0',
            name,
        )
        for name in sorted(names)
        if name.startswith("toxicity_") and name.removeprefix("toxicity_") in names
    }
    if {"toxicity", "word_count"} <= names:
        tests["the page's text"] = ("word_count > 0", "toxicity")
    if not files:
        return {}
    found = {}
    try:
        with database.asking() as con:
            for text, (there, score) in tests.items():
                # One after the other: of files whose rows all have a score no text is read.
                row = con.execute(
                    f'SELECT count(*) FROM read_parquet(?) WHERE "{score}" IS NULL AND {there}',
                    [[str(path) for path in files]],
                ).fetchone()
                if row and row[0]:
                    found[text] = int(row[0])
    except duckdb.Error as error:
        return damaged(f"clean rows of {declared.name}", error, again(declared.source))
    return found


def again(source: str) -> str:
    """How the clean rows of a source are made again."""
    again = f"run `{made_by(source)}"
    return f"{again}` again" if source in SOURCES else f"{again} --again`"
