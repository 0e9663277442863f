"""The gate: everything that speaks against publishing, all at once, one line each.

`check(run, folders)` looks at what the exports wrote; `check_made(run, folders)` at what `kb
release` added. An empty list opens the gate. Nothing is written here.
"""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from kb.artifacts import manifest, texts
from kb.artifacts.release_folder import TOMBSTONES, ReleasedTable, ReleaseFolder
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import DamagedData, KbError
from kb.core.licences import KNOWN, licence
from kb.core.resources import PROFILE_FILE
from kb.core.sources import SPECS
from kb.release.folders import DEPOSIT, samples, strays
from kb.release.gate import archives, checksums, columns, personal
from kb.release.gate import secrets as scan
from kb.release.gate import toxicity as scored
from kb.release.gate.problem import GateProblem, damaged
from kb.release.metadata.measure import folder_licence, page_licences
from kb.release.metadata.zenodo import Document
from kb.schema import Table, released_tables, table
from kb.store import database, parquet
from kb.store.digests import SUMS
from kb.store.layout import Layout


def check(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the exported data."""
    problems: list[GateProblem] = []
    for folder in folders:
        problems += _layout(folder)
        tables, whole = _tables(folder)
        problems += tables
        unreadable = [
            problem
            for declared in released_tables(folder.source)
            for problem in _clean(run.root, declared)
        ]
        problems += unreadable
        if not unreadable:
            for part in whole:
                problems += _counts(run.root, folder.source, part)
        problems += _absent(run.root, folder)
        if folder.source == "links" and not unreadable:
            problems += _older(run.root)
        problems += checksums.check(folder, folder.data)
        if len(whole) == len(folder.parts):
            problems += archives.check(folder)
            problems += _licence(run, folder)
        if not unreadable:
            problems += scored.check(run, folder, whole)
        for part in whole:
            problems += _age(run, folder.source, part)
        problems += scan.secrets(folder, run.settings.secret_values())
        problems += personal.personal(folder, run.profile.release)
    return problems


def check_made(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the files around the data: to be whole, right and without secrets."""
    problems: list[GateProblem] = []
    for folder in folders:
        for name in (
            "README.md",
            "DATASHEET.md",
            "CITATION.cff",
            "LICENSE",
            "croissant.json",
            PROFILE_FILE,
            "provenance.json",
            DEPOSIT,
            SUMS,
        ):
            if not (folder.path / name).is_file():
                problems.append(
                    GateProblem(
                        "incomplete", f"{folder.source}/{name}", "is not there; run `kb release`"
                    )
                )
        problems += checksums.check(folder, folder.files(), all_listed=True)
        problems += scan.secrets(folder, run.settings.secret_values())
        deposit = folder.path / DEPOSIT
        if deposit.is_file():
            problems += _deposit(deposit, f"{folder.source}/{DEPOSIT}")
    return problems


def _deposit(path: Path, where: str) -> list[GateProblem]:
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        if not body["metadata"].get("license"):
            return [GateProblem("licence", where, "names no licence; Zenodo would take CC0")]
        Document.model_validate(body)
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        return [
            GateProblem(
                "damaged",
                where,
                f"{'.'.join(map(str, first['loc']))}: {first['msg']}; run `kb release`",
            )
        ]
    except (ValueError, KeyError, TypeError, AttributeError):
        return [GateProblem("damaged", where, "can't be read; run `kb release`")]
    return []


def _layout(folder: ReleaseFolder) -> list[GateProblem]:
    """A flat folder of declared files."""
    problems = [
        GateProblem("layout", f"{folder.source}/{path.name}", "is a folder; a deposit is flat")
        for path in sorted(folder.path.iterdir())
        if path.is_dir() and not path.is_symlink() and not path.name.startswith(".")
    ]
    for path in strays(folder):
        what = (
            "is a link; a release needs real files"
            if path.is_symlink()
            else "is not part of a release; remove it"
        )
        problems.append(GateProblem("undeclared file", f"{folder.source}/{path.name}", what))
    return problems


def _tables(folder: ReleaseFolder) -> tuple[list[GateProblem], list[ReleasedTable]]:
    """Problems of Parquet files and samples, and the parts whose shards read as declared."""
    found: list[GateProblem] = []
    whole = []
    for part in folder.parts:
        names = [shard.name for shard in part.shards]
        if not columns.numbered(names, part.table.short, "parquet"):
            found.append(
                GateProblem(
                    "damaged",
                    f"{folder.source}/{part.table.short}",
                    "shards are missing or of two exports; export it again",
                )
            )
        problems = [
            problem
            for shard in part.shards
            for problem in columns.check(shard, part.table, folder.source)
        ]
        if not any(problem.check in ("damaged", "undescribed") for problem in problems):
            whole.append(part)
        found += problems
    tombstones = folder.path / TOMBSTONES
    if tombstones in folder.files():
        found += columns.check_rows(tombstones, table("shared/tombstones"), folder.source)
    for declared, path in samples(folder):
        found += columns.check_rows(path, declared, folder.source)
    return found, whole


def _clean(root: Path, declared: Table) -> list[GateProblem]:
    """Clean files that can't be read: nothing can be compared with them."""
    problems = []
    try:
        manifest.check_complete(root, declared.name)
    except DamagedData as error:
        return [GateProblem("damaged", declared.name, f"{error}; {error.hint}")]
    for path in Layout(root).rows(declared.name):
        try:
            parquet.check(path)
            pq.read_metadata(path)
        except (pa.ArrowException, OSError, DamagedData) as error:
            problems.append(
                damaged(str(path.relative_to(root)), error, scored.again(declared.source))
            )
    return problems


def _rows(paths: list[Path] | tuple[Path, ...]) -> int:
    return sum(parquet.footer(path).num_rows for path in paths)


def _counts(root: Path, source: str, part: ReleasedTable) -> list[GateProblem]:
    clean = Layout(root).rows(part.table.name)
    rows, expected = _rows(part.shards), _rows(clean)
    if rows == expected:
        return []
    return [
        GateProblem(
            "rows",
            f"{source}/{part.table.short}",
            f"{rows:,} released, {expected:,} clean; run the export again",
        )
    ]


def _absent(root: Path, folder: ReleaseFolder) -> list[GateProblem]:
    """Tables that were cleaned but never exported."""
    there = {part.table.name for part in folder.parts}
    return [
        GateProblem(
            "rows",
            f"{folder.source}/{declared.short}",
            "is clean but not exported; run the export again",
        )
        for declared in released_tables(folder.source)
        if declared.name not in there and Layout(root).rows(declared.name)
    ]


def _older(root: Path) -> list[GateProblem]:
    """Entity tables may name what a filter has dropped since."""
    what = "are older than clean/{}, and may name what was dropped since; run `kb links`"
    return [GateProblem("rows", "links", what.format(one)) for one in texts.changed(root, "links")]


def _licence(run: Run, folder: ReleaseFolder) -> list[GateProblem]:
    where = f"{folder.source}/LICENSE"
    named, unnamed = page_licences(folder)
    foreign = [name for name in named if name not in KNOWN]
    if foreign:
        what = (
            f"the pages name {', '.join(foreign[:3])}, which is no licence that a release can"
            f" carry (known: {', '.join(sorted(KNOWN))})"
        )
        return [
            GateProblem("licence", where, f"{what}; name the others with --only to release those")
        ]
    problems = []
    if named and unnamed:
        problems.append(
            GateProblem(
                "licence",
                f"{folder.source}/pages",
                f"{unnamed:,} rows name no licence, though others do; run `kb wiki crawl --again`",
            )
        )
    spdx = folder_licence(run, folder)
    if not spdx:
        return [
            *problems,
            GateProblem(
                "licence",
                where,
                f"none is given; set {folder.source} in [release.licenses] of the profile",
            ),
        ]
    try:
        licence(spdx)
    except KbError as error:
        problems.append(GateProblem("licence", where, f"{error}; {error.hint}"))
    return problems


def _max_age_days(run: Run, source: str) -> int | None:
    """How old rows may be: the source's own number first, then the release's."""
    section = getattr(run.profile, source, None)
    return getattr(section, "max_age_days", None) or run.profile.release.max_age_days


def _age(run: Run, source: str, part: ReleasedTable) -> list[GateProblem]:
    days = _max_age_days(run, source)
    if days is None or "fetched_at" not in part.table.names(released=True):
        return []
    limit = clock.now() - timedelta(days=days)
    with database.asking() as con:
        row = con.execute(
            "SELECT count(*), min(fetched_at)::DATE FROM read_parquet(?) WHERE fetched_at < ?",
            [[str(path) for path in part.shards], limit],
        ).fetchone()
    if not row or not row[0]:
        return []
    refreshed = source in SPECS and SPECS[source].refreshed
    what = f"{row[0]:,} rows were read more than {days} days ago (the oldest on {row[1]})"
    return [
        GateProblem(
            "age",
            f"{source}/{part.table.short}",
            f"{what}; run `kb refresh {source}`" if refreshed else what,
        )
    ]
