"""Compares released rows with the clean ones: their number, their age, and whether every text has
been scored.
"""

from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import pyarrow.parquet as pq

from kb.artifacts import manifest
from kb.artifacts.release_folder import ReleasedTable, ReleaseFolder
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import PUBLISHED, SOURCES, made_by, made_of
from kb.release.gate import GateProblem, damaged
from kb.schema import Table, released_tables
from kb.store.layout import Layout
from kb.store.tables import database, parquet


def check(run: Run, folder: ReleaseFolder, readable: list[ReleasedTable]) -> list[GateProblem]:
    """Every problem of rows of `readable` tables; with damaged clean rows nothing is compared."""
    unfinished = [
        GateProblem(
            "removed",
            folder.source,
            f"a purge of {source} has not finished; run `kb purge {source}` again",
        )
        for source in made_of(folder.source)
        if Layout(run.root).purge(source).exists()
    ]
    if unfinished:  # rows that were to be removed may still be here
        return unfinished
    if PUBLISHED[folder.source].part_of:
        return []
    tables = released_tables(folder.source)
    problems = [problem for one in tables for problem in _damaged(run.root, one)]
    if not problems:
        for part in readable:
            problems += _numbers(run.root, folder.source, part)
        problems += _unscored(run, folder, readable)
    exported = {part.table.name for part in folder.parts}
    problems += [
        GateProblem(
            "rows",
            f"{folder.source}/{declared.short}",
            "is clean but not exported; run the export again",
        )
        for declared in tables
        if declared.name not in exported and Layout(run.root).rows(declared.name)
    ]
    return problems + [problem for part in readable for problem in _age(run, folder.source, part)]


def _damaged(root: Path, declared: Table) -> list[GateProblem]:
    """Clean files that can't be read."""
    problems = []
    try:
        manifest.check_complete(root, declared.name)
    except DamagedData as error:
        return [GateProblem("damaged", declared.name, f"{error}; {error.hint}")]
    command = made_by(declared.source) + ("" if declared.source in SOURCES else " --again")
    again = " again" if declared.source in SOURCES else ""
    for path in Layout(root).rows(declared.name):
        try:
            parquet.open_file(path).close()
        except DamagedData as error:
            where = str(path.relative_to(root))
            problems.append(damaged(where, error, f"run `{command}`{again}"))
    return problems


def _numbers(root: Path, source: str, part: ReleasedTable) -> list[GateProblem]:
    released, clean = (
        sum(pq.read_metadata(path).num_rows for path in paths)
        for paths in (part.shards, Layout(root).rows(part.table.name))
    )
    if released == clean:
        return []
    what = f"{released:,} released, {clean:,} clean; run the export again"
    return [GateProblem("rows", f"{source}/{part.table.short}", what)]


def _age(run: Run, source: str, part: ReleasedTable) -> list[GateProblem]:
    """Rows that are older than the source's own limit, else the release's."""
    section = getattr(run.profile, source, None)
    days = getattr(section, "max_age_days", None) or run.profile.release.max_age_days
    if days is None or "fetched_at" not in part.table.names(released=True):
        return []
    limit = clock.now() - timedelta(days=days)
    # The terms of a service are about what it was asked for, not about files that people have.
    aging = PUBLISHED[source].aging
    asked = " OR ".join(f"{column} = '{value}'" for column, value in aging) or "true"
    with database.asking() as con:
        row = con.execute(
            "SELECT count(*), min(fetched_at)::DATE FROM read_parquet(?)"
            f" WHERE fetched_at < ? AND ({asked})",
            [[str(path) for path in part.shards], limit],
        ).fetchone()
    if not row or not row[0]:
        return []
    what = f"{row[0]:,} rows were read more than {days} days ago (the oldest on {row[1]})"
    if source in SOURCES and SOURCES[source].refreshed:
        what = f"{what}; run `kb refresh {source}`"
    return [GateProblem("age", f"{source}/{part.table.short}", what)]


def _unscored(run: Run, folder: ReleaseFolder, readable: list[ReleasedTable]) -> list[GateProblem]:
    """Texts without a toxicity score, in clean/ and as released."""
    if not run.profile.toxicity.on:
        return []  # the card says so
    shards = {part.table.name: part.shards for part in readable}
    problems = []
    for declared in released_tables(folder.source):
        where = f"{folder.source}/{declared.short}"
        clean = _count_unscored(Layout(run.root).rows(declared.name), {*declared.names()})
        command = f"run `kb {folder.source} filter` and `kb {folder.source} export` again"
        problems += [
            GateProblem(
                "toxicity", where, f"{rows:,} rows have no toxicity score of {text}; {command}"
            )
            for text, rows in clean.items()
        ]
        names = {*declared.names(released=True)}
        released = _count_unscored(shards.get(declared.name, ()), names)
        what = "released rows have no toxicity score of"
        problems += [
            GateProblem("toxicity", where, f"{rows:,} {what} {text}; run the export again")
            for text, rows in released.items()
            if rows > clean.get(text, 0)
        ]
    return problems


def _count_unscored(files: Sequence[Path], names: set[str]) -> dict[str, int]:
    """Text → rows with that text and without its score; `toxicity_<text>` belongs to `<text>`."""
    if not files:
        return {}
    texts = sorted(name for name in names if f"toxicity_{name}" in names)
    tests = {text: (f'length(trim("{text}")) > 0', f"toxicity_{text}") for text in texts}
    if {"toxicity", "word_count"} <= names:
        tests["the page's text"] = ("word_count > 0", "toxicity")
    counts = {}
    with database.asking() as con:
        for text, (present, score) in tests.items():
            # One after the other: where every row has a score, no text is read.
            row = con.execute(
                f'SELECT count(*) FROM read_parquet(?) WHERE "{score}" IS NULL AND {present}',
                [[str(path) for path in files]],
            ).fetchone()
            if row and row[0]:
                counts[text] = int(row[0])
    return counts
