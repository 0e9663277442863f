"""The gate: everything that speaks against publishing, all at once, one line each.

`check(run, folders)` looks at what the exports wrote; `check_made(run, folders)` at what `kb
release` added. An empty list opens the gate. Nothing is written here.
"""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from kb.core import clock
from kb.core.errors import KbError
from kb.release import checksums, scan
from kb.release.folders import DEPOSIT, SUMS, Folder, Part, clean_files, released_tables
from kb.release.licences import licence
from kb.release.measure import folder_licence
from kb.release.problem import Problem

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.core.context import Run

_REDDIT_LONGEST = 16  # ids, types and full names; anything longer is content


def check(run: Run, folders: list[Folder]) -> list[Problem]:
    """Every problem of the exported data."""
    problems: list[Problem] = []
    for folder in folders:
        problems += _files(folder)
        broken = {problem.where for problem in problems}
        whole = [part for part in folder.parts if not any(f"{folder.source}/{shard.name}" in broken for shard in part.shards)]
        problems += [found for part in whole for found in _counts(run.root, folder.source, part)]
        problems += _absent(run.root, folder)
        problems += checksums.check(folder, folder.data)
        problems += _licence(run, folder)
        problems += _scores(run, folder)
        problems += [found for part in whole for found in _age(run, folder.source, part)]
        problems += scan.secrets(folder, run.settings.secret_values())
        problems += scan.personal(folder, run.profile.release)
    return problems


def check_made(run: Run, folders: list[Folder]) -> list[Problem]:
    """Every problem of the files around the data: to be whole, right and without secrets."""
    problems: list[Problem] = []
    for folder in folders:
        for name in ("README.md", "DATASHEET.md", "CITATION.cff", "LICENSE", "croissant.json", DEPOSIT, SUMS):
            if not (folder.path / name).is_file():
                problems.append(Problem("incomplete", f"{folder.source}/{name}", "is not there; run `kb release`"))
        problems += checksums.check(folder, folder.files(), all_listed=True)
        problems += scan.secrets(folder, run.settings.secret_values())
        deposit = folder.path / DEPOSIT
        if deposit.is_file() and not _names_licence(deposit):
            problems.append(Problem("licence", f"{folder.source}/{DEPOSIT}", "names no licence; Zenodo would take CC0"))
    return problems


def _names_licence(path: Path) -> bool:
    try:
        return bool(json.loads(path.read_text(encoding="utf-8"))["metadata"]["license"])
    except (ValueError, KeyError, TypeError):
        return False


def _files(folder: Folder) -> list[Problem]:
    """Every file readable, flat and declared; every column described and meant for release."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    found = [
        Problem("layout", f"{folder.source}/{path.name}", "is a folder; a deposit is flat")
        for path in sorted(folder.path.iterdir())
        if path.is_dir() and not path.name.startswith(".")
    ]
    for part in folder.parts:
        found += _numbering(folder, part)
        for shard in part.shards:
            where = f"{folder.source}/{shard.name}"
            try:
                schema = pq.read_schema(shard)
            except (pa.ArrowInvalid, OSError) as error:
                found.append(Problem("damaged", where, f"can't be read ({str(error).splitlines()[0][:80]}); export it again"))
                continue
            found += _columns(part, schema, where)
            if folder.source == "reddit":
                found += _reddit_values(shard, where)
    for path in folder.others:
        if path.suffix == ".parquet":
            found.append(Problem("undescribed", f"{folder.source}/{path.name}", "is no table of schemas/"))
    return found


def _numbering(folder: Folder, part: Part) -> list[Problem]:
    total = len(part.shards)
    names = [f"{part.table.short}-{index:05d}-of-{total:05d}.parquet" for index in range(total)]
    if names == [shard.name for shard in part.shards]:
        return []
    return [Problem("damaged", f"{folder.source}/{part.table.short}", "shards are missing or of two exports; export it again")]


def _columns(part: Part, schema: pa.Schema, where: str) -> list[Problem]:
    declared = {column.name: column for column in part.table.columns}
    expected = part.table.arrow(True)
    found = []
    for field in schema:
        column = declared.get(field.name)
        if column is None:
            found.append(Problem("undescribed", where, f"column {field.name} is not described in schemas/"))
        elif not column.released:
            word = "content" if column.content else "unreleased"
            found.append(Problem(word, where, f"column {field.name} may not be released"))
        elif field.type != expected.field(field.name).type:
            found.append(Problem("undescribed", where, f"column {field.name} is {field.type}, schemas/ says {column.type}"))
    found += [Problem("undescribed", where, f"column {name} is missing") for name in expected.names if name not in schema.names]
    return found


def _reddit_values(shard: Path, where: str) -> list[Problem]:
    """No text of a released Reddit table may be longer than an id or hold an address, whatever its column says."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    found = []
    file = pq.ParquetFile(shard)
    for name in [field.name for field in file.schema_arrow if pa.types.is_string(field.type)]:
        for batch in file.iter_batches(columns=[name]):
            values = batch.column(0).drop_null()
            odd = pc.or_(pc.greater(pc.utf8_length(values), _REDDIT_LONGEST), pc.match_substring_regex(values, r"[\s/@]"))
            if pc.any(odd).as_py():
                found.append(Problem("content", where, f"column {name} holds text that is no id"))
                break
    return found


def _rows(paths: list[Path] | tuple[Path, ...]) -> int:
    import pyarrow.parquet as pq

    return sum(pq.read_metadata(path).num_rows for path in paths)


def _counts(root: Path, source: str, part: Part) -> list[Problem]:
    clean = clean_files(root, part.table)
    rows, expected = _rows(part.shards), _rows(clean)
    if rows == expected:
        return []
    return [Problem("rows", f"{source}/{part.table.short}", f"{rows:,} released, {expected:,} clean; run the export again")]


def _absent(root: Path, folder: Folder) -> list[Problem]:
    """Tables that were cleaned but never exported."""
    there = {part.table.name for part in folder.parts}
    return [
        Problem("rows", f"{folder.source}/{declared.short}", "is clean but not exported; run the export again")
        for declared in released_tables(folder.source)
        if declared.name not in there and clean_files(root, declared)
    ]


def _licence(run: Run, folder: Folder) -> list[Problem]:
    where = f"{folder.source}/LICENSE"
    spdx = folder_licence(run, folder)
    if not spdx:
        return [Problem("licence", where, f"none is given; set {folder.source} in [release.licenses] of the profile")]
    try:
        licence(spdx)
    except KbError as error:
        return [Problem("licence", where, f"{error}; {error.hint}")]
    return []


def _scores(run: Run, folder: Folder) -> list[Problem]:
    """Every text that the source has must have been scored; `toxicity_<text>` belongs to `<text>`."""
    import duckdb

    found = []
    for declared in released_tables(folder.source):
        files = clean_files(run.root, declared)
        if not files:
            continue
        names = {column.name for column in declared.columns}
        pairs = [
            (name.removeprefix("toxicity_"), name)
            for name in sorted(names)
            if name.removeprefix("toxicity_") in names and name.startswith("toxicity_")
        ]
        tests = {text: f'length(trim("{text}")) > 0 AND "{score}" IS NULL' for text, score in pairs}
        if "toxicity" in names and "word_count" in names:
            tests["the page's text"] = "word_count > 0 AND toxicity IS NULL"
        for text, test in tests.items():
            row = duckdb.connect().execute(f"SELECT count(*) FROM read_parquet(?) WHERE {test}", [[str(path) for path in files]]).fetchone()
            if row and row[0]:
                what = f"{row[0]:,} rows have no toxicity score of {text}"
                what += "; run `kb annotate`" if run.profile.toxicity.on else "; the release is incomplete, toxicity is off in the profile"
                found.append(Problem("toxicity", f"{folder.source}/{declared.short}", what))
    return found


def max_age_days(run: Run, source: str) -> int | None:
    """How old rows may be: the source's own number first, then the release's."""
    section = getattr(run.profile, source, None)
    return getattr(section, "max_age_days", None) or run.profile.release.max_age_days


def _age(run: Run, source: str, part: Part) -> list[Problem]:
    import duckdb

    days = max_age_days(run, source)
    if days is None or "fetched_at" not in part.table.names(released=True):
        return []
    limit = clock.now() - timedelta(days=days)
    row = (
        duckdb.connect()
        .execute(
            "SELECT count(*), min(fetched_at)::DATE FROM read_parquet(?) WHERE fetched_at < ?",
            [[str(path) for path in part.shards], limit],
        )
        .fetchone()
    )
    if not row or not row[0]:
        return []
    what = f"{row[0]:,} rows were read more than {days} days ago (the oldest on {row[1]})"
    return [
        Problem(
            "age",
            f"{source}/{part.table.short}",
            f"{what}; run `kb refresh {source}`" if source in ("youtube", "reddit") else what,
        )
    ]
