"""The wiki's archives: every file that a path column names is there, whole, by the index beside the
tars.

Tables and index are joined in DuckDB, so memory does not grow with the number of images.
"""

from __future__ import annotations

import duckdb

from kb.artifacts.release_folder import INDEX, ReleaseFolder
from kb.core.sources import RELEASES, exported_by
from kb.release.gate.columns import numbered
from kb.release.gate.problem import GateProblem, damaged
from kb.store import database

_COLUMNS = (
    "{tar: 'VARCHAR', member: 'VARCHAR', \"offset\": 'BIGINT', size: 'BIGINT', sha256: 'VARCHAR'}"
)


def check(folder: ReleaseFolder) -> list[GateProblem]:
    """Every problem of the archives; nothing for a source that has none."""
    source, spec = folder.source, RELEASES[folder.source]
    again = f"run `{exported_by(source)}` again"
    if not spec.archives:
        return []
    tars = {path.name: path.stat().st_size for path in folder.others if path.suffix == ".tar"}
    problems = [
        GateProblem(
            "damaged", f"{source}/{kind}", f"archives are missing or of two exports; {again}"
        )
        for kind in spec.archives
        if not numbered([name for name in tars if name.startswith(kind)], kind, "tar")
    ]
    index = folder.path / INDEX
    if not index.is_file():
        return [
            *problems,
            GateProblem("damaged", f"{source}/{INDEX}", f"is not there; {again}"),
        ]
    with database.asking() as con:
        con.execute("CREATE TEMP TABLE tars (tar VARCHAR, bytes BIGINT)")
        if tars:
            con.executemany("INSERT INTO tars VALUES (?, ?)", list(tars.items()))
        try:
            con.execute(
                'CREATE TEMP TABLE held AS SELECT tar, member, "offset", size'
                f" FROM read_json(?, format = 'newline_delimited', columns = {_COLUMNS})",
                [str(index)],
            )
            cut = con.execute(
                "SELECT tar, count(*) FROM held LEFT JOIN tars USING (tar)"
                ' WHERE coalesce(bytes, 0) < "offset" + size GROUP BY 1 ORDER BY 1'
            ).fetchall()
        except duckdb.Error as error:
            return [*problems, damaged(f"{source}/{INDEX}", error, again)]
        for tar, files in cut:
            what = (
                f"is cut off: {files:,} of its files end beyond it"
                if tar in tars
                else f"is not there; {INDEX} names {files:,} files in it"
            )
            problems.append(GateProblem("damaged", f"{source}/{tar}", f"{what}; {again}"))
        for part in folder.parts:
            for column in (column for short, column in spec.paths if short == part.table.short):
                missing = (
                    f"SELECT count(*) FROM read_parquet(?) WHERE {column} NOT IN (SELECT tar"
                    " || '/' || member FROM held)"
                )
                rows = con.execute(missing, [[str(shard) for shard in part.shards]]).fetchall()[0][
                    0
                ]
                if rows:
                    problems.append(
                        GateProblem(
                            "damaged",
                            f"{source}/{part.table.short}",
                            f"{rows:,} rows name a file in {column} that no archive holds; {again}",
                        )
                    )
    return problems
