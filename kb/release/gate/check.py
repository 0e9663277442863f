"""The gate: every reason not to publish, all at once, one line each.

`check(run, folders)` reads what the exports wrote, `check_made(run, folders)` what `kb release`
added. An empty list opens the gate. Nothing is written here. This module checks the files,
checksums, archives and licence of a folder; its tables and contents have their own.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import duckdb
from pydantic import ValidationError

from kb.artifacts import release_folder
from kb.artifacts.release_folder import INDEX, ReleaseFolder
from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.licences import KNOWN, licence
from kb.core.sources import PUBLISHED
from kb.release.folders import DEPOSIT, REQUIRED, is_made, strays
from kb.release.gate import GateProblem, contents, damaged, tables
from kb.release.gate.tables import numbered
from kb.release.metadata.measure import folder_licence, licences
from kb.release.metadata.zenodo import Document
from kb.store.artifact_registry import ARTIFACTS, SUMS
from kb.store.exhausted import is_out_of_memory
from kb.store.tables import database, parquet
from kb.store.tables.checksums import digest

_COLUMNS = (
    "{tar: 'VARCHAR', member: 'VARCHAR', \"offset\": 'BIGINT', size: 'BIGINT', sha256: 'VARCHAR'}"
)


def check_layout(folder: ReleaseFolder) -> list[GateProblem]:
    """What is not a declared file of a flat folder."""
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


def check_sums(
    folder: ReleaseFolder, files: Sequence[Path], *, all_listed: bool = False
) -> list[GateProblem]:
    """Files that differ from SHA256SUMS or are missing; with `all_listed` also unlisted files.

    Without `all_listed` files that `kb release` makes may be missing.
    """
    sums, invalid = release_folder.sums(folder.path)
    if invalid:
        what = "can't be read as a list of checksums; export it again"
        return [GateProblem("damaged", f"{folder.source}/{SUMS}", what)]
    problems = []
    for file in files:
        where = f"{folder.source}/{file.name}"
        if file.name not in sums:
            if all_listed and sums:
                what = f"is not in {SUMS}; run `kb release`"
                problems.append(GateProblem("checksum", where, what))
        elif digest(file) != sums[file.name]:
            problems.append(GateProblem("checksum", where, f"differs from {SUMS}; export it again"))
    what = f"is in {SUMS} but missing; export it again"
    return problems + [
        GateProblem("checksum", f"{folder.source}/{name}", what)
        for name in sums
        if not (folder.path / name).exists() and (all_listed or not is_made(name, folder.source))
    ]


def check_archives(folder: ReleaseFolder) -> list[GateProblem]:
    """Problems of tar files, and rows whose file is in none of them; nothing for most sources."""
    source, of = folder.source, PUBLISHED[folder.source]
    if not of.archives:
        return []
    rerun = ARTIFACTS[f"release/{source}"].hint
    tars = {path.name: path.stat().st_size for path in folder.others if path.suffix == ".tar"}
    problems = [
        GateProblem(
            "damaged", f"{source}/{kind}", f"archives are missing or of two exports; {rerun}"
        )
        for kind in of.archives
        if not numbered([name for name in tars if name.startswith(kind)], kind, "tar")
    ]
    index = folder.path / INDEX
    if not index.is_file():
        return [*problems, GateProblem("damaged", f"{source}/{INDEX}", f"is missing; {rerun}")]
    with database.asking() as con:
        con.execute("CREATE TEMP TABLE tars (tar VARCHAR, bytes BIGINT)")
        if tars:
            con.executemany("INSERT INTO tars VALUES (?, ?)", list(tars.items()))
        try:
            con.execute(
                'CREATE TEMP TABLE members AS SELECT tar, member, "offset", size'
                f" FROM read_json(?, format = 'newline_delimited', columns = {_COLUMNS})",
                [str(index)],
            )
            cut = con.execute(
                "SELECT tar, count(*) FROM members LEFT JOIN tars USING (tar)"
                ' WHERE coalesce(bytes, 0) < "offset" + size GROUP BY 1 ORDER BY 1'
            ).fetchall()
        except duckdb.Error as error:
            if is_out_of_memory(error):
                raise
            return [*problems, damaged(f"{source}/{INDEX}", error, rerun)]
        for tar, files in cut:
            what = (
                f"is cut off: {files:,} of its files end beyond it"
                if tar in tars
                else f"is missing; {INDEX} names {files:,} files in it"
            )
            problems.append(GateProblem("damaged", f"{source}/{tar}", f"{what}; {rerun}"))
        for part in folder.parts:
            for column in (column for short, column in of.paths if short == part.table.short):
                missing = (
                    f"SELECT count(*) FROM read_parquet(?) WHERE {column} NOT IN (SELECT tar"
                    " || '/' || member FROM members)"
                )
                shards = [str(shard) for shard in part.shards]
                ((rows,),) = con.execute(missing, [shards]).fetchall()
                if rows:
                    what = f"{rows:,} rows name a file in {column} that is in no archive; {rerun}"
                    problems.append(GateProblem("damaged", f"{source}/{part.table.short}", what))
    return problems


def check(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the exported data."""
    problems: list[GateProblem] = []
    for folder in folders:
        problems += check_layout(folder)
        of_tables, readable = tables.check(folder)
        problems += of_tables
        problems += tables.check_rows(run, folder, readable)
        problems += check_sums(folder, folder.data)
        if len(readable) == len(folder.parts):
            problems += check_archives(folder)
            problems += _licence(run, folder)
        problems += contents.check_secrets(folder, run.settings.secret_values())
        problems += contents.check_personal(
            replace(folder, parts=tuple(readable)), run.profile.release
        )
    return problems


def check_made(run: Run, folders: list[ReleaseFolder]) -> list[GateProblem]:
    """Every problem of the files around the data: missing, invalid, or with secrets."""
    problems: list[GateProblem] = []
    for folder in folders:
        problems += [
            GateProblem("incomplete", f"{folder.source}/{name}", "is missing; run `kb release`")
            for name in REQUIRED
            if not (folder.path / name).is_file()
        ]
        problems += check_sums(folder, folder.files(), all_listed=True)
        problems += contents.check_secrets(folder, run.settings.secret_values())
        if (folder.path / DEPOSIT).is_file():
            problems += _deposit(folder.path / DEPOSIT, f"{folder.source}/{DEPOSIT}")
    return problems


def _deposit(path: Path, where: str) -> list[GateProblem]:
    """Problems of zenodo.json."""
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        if not body["metadata"].get("license"):
            return [GateProblem("licence", where, "names no licence; Zenodo would take CC0")]
        Document.model_validate(body)
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}; run `kb release`"
        return [GateProblem("damaged", where, what)]
    except (ValueError, KeyError, TypeError, AttributeError):
        return [GateProblem("damaged", where, "can't be read; run `kb release`")]
    return []


def _licence(run: Run, folder: ReleaseFolder) -> list[GateProblem]:
    """Problems of the licence that the folder is to be released under."""
    where = f"{folder.source}/LICENSE"
    of = PUBLISHED[folder.source]
    named = dict(licences(folder, of.main)) if of.licensed else {}
    foreign = sorted(name for name in named if name not in KNOWN)
    if foreign:
        what = (
            f"the pages name {', '.join(foreign[:3])}, which is not a licence that a release can"
            f" use (known: {', '.join(sorted(KNOWN))}); release the other folders with --only"
        )
        return [GateProblem("licence", where, what)]
    problems = []
    main = sum(parquet.footer(shard).num_rows for shard in folder.shards(of.main))
    if named and (unnamed := main - sum(named.values())):
        what = (
            f"{unnamed:,} rows name no licence, though others do;"
            f" run `kb {folder.source} crawl --again`"
        )
        problems.append(GateProblem("licence", f"{folder.source}/pages", what))
    spdx = folder_licence(run, folder)
    if not spdx:
        what = f"none is given; set {folder.source} in [release.licenses] of the profile"
        return [*problems, GateProblem("licence", where, what)]
    try:
        licence(spdx)
    except KbError as error:
        problems.append(GateProblem("licence", where, f"{error}; {error.hint}"))
    return problems
