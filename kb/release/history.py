"""What changed since the release before: rows added and gone, by table.

`kb release` notes for each folder and version which keys it holds, as digests, in
state/releases/<source>/<version>.parquet. A release is compared with the newest lower version that
was noted, so that making the same version again changes nothing in it.
"""

import json
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from kb.artifacts.release_folder import ReleaseFolder
from kb.core.errors import DamagedData
from kb.release.metadata.facts import Facts
from kb.store.atomic import writing
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database, parquet

_ABOUT = b"lorebase"  # a name on disk, kept from the time before the project was renamed


class TableChange(msgspec.Struct, frozen=True):
    """One table since the release before."""

    table: str
    added: int
    gone: int


class Changes(msgspec.Struct, frozen=True):
    """A folder since the release before; `version` empty: there is none."""

    version: str = ""
    built: str = ""
    tables: tuple[TableChange, ...] = ()
    tombstones: int = 0  # keys that were removed since


def changes(root: Path, folder: ReleaseFolder, facts: Facts, version: str) -> Changes:
    """What is new and what is gone. Raises DamagedData for a note that can't be read."""
    before = _before(root, folder.source, version)
    if before is None:
        return Changes()
    parquet.check(before)
    try:
        recorded = json.loads((pq.read_schema(before).metadata or {}).get(_ABOUT, b"{}"))
        with database.asking() as con:
            con.register("now", _keys(folder))
            counted = con.execute(
                """SELECT coalesce(n."table", o."table") AS t,
                    count(*) FILTER (o.key IS NULL), count(*) FILTER (n.key IS NULL)
                FROM now n FULL JOIN read_parquet(?) o ON n."table" = o."table" AND n.key = o.key
                GROUP BY t ORDER BY t""",
                [str(before)],
            ).fetchall()
    except (pa.ArrowInvalid, ValueError, OSError) as error:
        raise DamagedData(
            f"{before} can't be read: {error}",
            hint="remove it; changes since that version will be unknown",
        ) from None
    return Changes(
        version=before.stem,
        built=recorded.get("built", ""),
        tables=tuple(TableChange(*one) for one in counted),
        tombstones=max(0, facts.tombstones - recorded.get("tombstones", 0)),
    )


def note(root: Path, folder: ReleaseFolder, facts: Facts, version: str) -> None:
    """Keep what this version holds, for the next one."""
    about = {"built": facts.built.strftime("%Y-%m-%d"), "tombstones": facts.tombstones}
    keys = _keys(folder).replace_schema_metadata({_ABOUT: json.dumps(about).encode()})
    path = Layout(root).released(folder.source) / f"{version}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    with writing(path) as fresh:
        parquet.write(fresh, keys)


def _before(root: Path, source: str, version: str) -> Path | None:
    noted = parquet_files(Layout(root).released(source))
    lower = [path for path in noted if _number(path.stem) < _number(version)]
    return max(lower, key=lambda path: _number(path.stem), default=None)


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part.isdigit())


def _keys(folder: ReleaseFolder) -> pa.Table:
    """table, key (a digest of the row's key) of every row, sorted."""
    parts = []
    with database.asking() as con:
        for part in folder.parts:
            columns = ", ".join(f'"{name}"::VARCHAR' for name in part.table.key)
            rows: pa.Table = con.sql(
                f"""SELECT ? AS "table", md5_number_lower(concat_ws(chr(31), {columns})) AS key
                FROM read_parquet(?) ORDER BY key""",
                params=[part.table.short, [str(shard) for shard in part.shards]],
            ).to_arrow_table()
            parts.append(rows)
    return pa.concat_tables(parts)
