"""Checks the files of a release folder: only declared ones, SHA256SUMS, and archives.

Tables and the index of the archives are joined in DuckDB, so memory does not grow with the number
of images.
"""

from collections.abc import Sequence
from pathlib import Path

import duckdb

from kb.artifacts import release_folder
from kb.artifacts.release_folder import INDEX, ReleaseFolder
from kb.core.sources import RELEASES, exported_by
from kb.release.folders import is_made, strays
from kb.release.gate import GateProblem, damaged
from kb.release.gate.tables import numbered
from kb.store.tables import database
from kb.store.tables.checksums import SUMS, digest

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
    source, spec = folder.source, RELEASES[folder.source]
    if not spec.archives:
        return []
    rerun = f"run `{exported_by(source)}` again"
    tars = {path.name: path.stat().st_size for path in folder.others if path.suffix == ".tar"}
    problems = [
        GateProblem(
            "damaged", f"{source}/{kind}", f"archives are missing or of two exports; {rerun}"
        )
        for kind in spec.archives
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
            return [*problems, damaged(f"{source}/{INDEX}", error, rerun)]
        for tar, files in cut:
            what = (
                f"is cut off: {files:,} of its files end beyond it"
                if tar in tars
                else f"is missing; {INDEX} names {files:,} files in it"
            )
            problems.append(GateProblem("damaged", f"{source}/{tar}", f"{what}; {rerun}"))
        for part in folder.parts:
            for column in (column for short, column in spec.paths if short == part.table.short):
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
