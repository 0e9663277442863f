"""Raw answers of a reconstruction → tables. Rows of one post meet in a bucket, so memory is bounded by one."""

from __future__ import annotations

import re
import zlib
from contextlib import ExitStack
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.core.errors import SettingError
from kb.core.profile.reddit import Links
from kb.reddit import parse
from kb.reddit.assemble import assemble, newest_of
from kb.reddit.wanted import Wanted
from kb.schema.tables import Table, table
from kb.store import database, rawlog
from kb.store.atomic import full_disk_is_resumable, replacing_folder
from kb.store.shards import write_table

if TYPE_CHECKING:
    import pyarrow as pa

IDS = 200_000  # a bucket
DONE, WORK, MISSING = ".done.json", ".work-", "missing.parquet"
_NAMES = ("posts", "comments")
_PART = re.compile(r"part-\d{5,}\.parquet\Z")


def check_place(out: Path) -> None:
    """Raise SettingError where writing the tables would delete what no reconstruction made."""
    if out.exists() and not out.is_dir():
        raise SettingError(f"--out {out} is no folder", hint="give a folder")
    ours = (out / DONE).exists() or (out / MISSING).exists() or any(out.glob(f"{WORK}*"))
    for place in (out / name for name in _NAMES):
        there = (
            sorted(place.iterdir())
            if place.is_dir() and not place.is_symlink()
            else [place]
            if place.exists() or place.is_symlink()
            else []
        )
        foreign = [
            path for path in there if not (ours and _PART.match(path.name) and path.is_file())
        ]
        if foreign:
            raise SettingError(
                f"--out: {foreign[0]} was not made by a reconstruction and would be deleted",
                hint="give another folder",
            )


def are_whole(out: Path, counts: dict[str, int]) -> bool:
    """Whether the tables below `out` are all there, with so many rows."""
    import pyarrow.parquet as pq

    try:
        for name in _NAMES:
            parts = list((out / name).glob("*.parquet"))
            if not parts or sum(pq.read_metadata(path).num_rows for path in parts) != counts[name]:
                return False
        return pq.read_metadata(out / MISSING).num_rows == counts["missing"]
    except (OSError, ValueError, KeyError):
        return False


def write(
    work: Path,
    out: Path,
    wanted: Wanted,
    unanswered: dict[str, str],
    links: Links,
    depths: pa.Table | None = None,
) -> dict[str, int]:
    """posts/, comments/ and missing.parquet below `out`; how many rows each has (`missing` without those that failed).

    Raises DamagedData, DiskFull.

    `depths` (comment_id, depth) fills in where ancestors are gone.
    """

    buckets = 1 + (len(wanted.names) + 50 * len(wanted.trees)) // IDS
    with full_disk_is_resumable(work), ExitStack() as folders:
        spread = work / "rows"
        _spread(work, spread, buckets, links)
        fresh = {name: folders.enter_context(replacing_folder(out / name)) for name in _NAMES}
        counts = {"posts": 0, "comments": 0}
        gone: dict[str, str] = {}
        for number in range(buckets):
            newest = {
                kind: _read(spread / kind / f"{number}.arrow")
                for kind in parse.KINDS
                if (spread / kind / f"{number}.arrow").exists()
            }
            if not newest:
                continue
            made = assemble(newest)
            posts = made["reddit/posts"]
            for name, rows in (
                ("posts", posts),
                ("comments", made["reddit/comments"]({"reddit/posts": posts})),
            ):
                kept = _sort(
                    rows, table(f"reddit/{name}"), "t3_" if name == "posts" else "t1_", gone
                )
                if name == "comments" and depths is not None:
                    kept = _deep(kept, depths)
                if kept.num_rows:
                    write_table(fresh[name] / f"part-{number:05d}.parquet", kept, f"reddit/{name}")
                    counts[name] += kept.num_rows
        for name in _NAMES:
            if not counts[name]:
                write_table(
                    fresh[name] / "part-00000.parquet",
                    table(f"reddit/{name}").arrow().empty_table(),
                    f"reddit/{name}",
                )
        lost = _lost(spread, fresh, wanted, {**unanswered, **gone})
        write_table(out / MISSING, lost, "reddit/missing")
    return {**counts, "missing": sum(reason != "failed" for reason in lost["reason"].to_pylist())}


def _lost(
    scratch: Path, made: dict[str, Path], wanted: Wanted, reasons: dict[str, str]
) -> pa.Table:
    """What is in no table and was asked for, or has a reason. All that was asked for stays on disk."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    scratch.mkdir(parents=True, exist_ok=True)
    names = chain(wanted.names, (f"t3_{key}" for key in wanted.trees))
    with pq.ParquetWriter(scratch / "asked.parquet", pa.schema([("key", pa.string())])) as file:
        while part := list(islice(names, IDS)):
            file.write_batch(pa.record_batch({"key": pa.array(part, pa.string())}))
    with database.connect(scratch, memory="1GB") as con:
        con.register(
            "reasons",
            pa.table(
                {
                    "key": pa.array(reasons.keys(), pa.string()),
                    "reason": pa.array(reasons.values(), pa.string()),
                }
            ),
        )
        return con.sql(
            "WITH there AS ("
            " SELECT 't3_' || post_id AS key FROM read_parquet($posts) UNION ALL SELECT 't1_' || comment_id FROM read_parquet($comments)),"
            " asked AS (SELECT key FROM read_parquet($asked) UNION SELECT key FROM reasons)"
            " SELECT key, coalesce(reason, 'missing') AS reason FROM asked ANTI JOIN there USING (key) LEFT JOIN reasons USING (key)",
            params={
                "asked": str(scratch / "asked.parquet"),
                **{name: [str(path) for path in folder.iterdir()] for name, folder in made.items()},
            },
        ).to_arrow_table()


def _spread(work: Path, spread: Path, buckets: int, links: Links) -> None:
    import pyarrow as pa

    with ExitStack() as stack:
        writers: dict[tuple[str, int], Any] = {}
        for kind in rawlog.kinds(work, "reddit"):
            lines = (
                line
                for path in rawlog.segments(work, "reddit", kind)
                for _, line in rawlog.Frames(path)
            )
            for rows in parse.rows(lines, kind, links):
                # By post where it is known; what was not answered is on its own.
                place = [
                    zlib.crc32((post or name).encode()) % buckets
                    for post, name in zip(
                        rows["post_id"].to_pylist(), rows["fullname"].to_pylist(), strict=True
                    )
                ]
                for number in sorted(set(place)):
                    if (kind, number) not in writers:
                        (spread / kind).mkdir(parents=True, exist_ok=True)
                        writers[kind, number] = stack.enter_context(
                            pa.ipc.new_file(str(spread / kind / f"{number}.arrow"), parse.schema())
                        )
                    writers[kind, number].write_table(
                        rows.filter(pa.array([one == number for one in place]))
                    )


def _read(path: Path) -> pa.Table:
    import pyarrow as pa

    with pa.ipc.open_file(path) as file:
        return newest_of({"info": file.read_all()})


def _sort(rows: pa.Table, declared: Table, prefix: str, gone: dict[str, str]) -> pa.Table:
    """The rows that are there and whole, with the table's columns; the rest is noted in `gone`."""
    import pyarrow as pa

    reasons = [
        _reason(state, why)
        for state, why in zip(rows["state"].to_pylist(), rows["gone"].to_pylist(), strict=True)
    ]
    needed = [
        rows[column.name].is_valid().to_pylist()
        for column in declared.columns
        if not column.nullable and column.name in rows.column_names
    ]
    reasons = (
        [
            reason or (None if all(whole) else "malformed")
            for reason, whole in zip(reasons, zip(*needed, strict=True), strict=True)
        ]
        if needed
        else reasons
    )
    for name, reason in zip(rows["fullname"].to_pylist(), reasons, strict=True):
        if reason is not None:
            gone[name] = reason
    kept = rows.filter(pa.array([reason is None for reason in reasons], pa.bool_()))
    for field in declared.arrow():
        if field.name not in kept.column_names:
            kept = kept.append_column(field.name, pa.nulls(kept.num_rows, field.type))
    return kept.select(declared.names())


def _deep(rows: pa.Table, depths: pa.Table) -> pa.Table:
    import pyarrow.compute as pc

    known = depths["depth"].take(
        pc.index_in(rows["comment_id"], value_set=depths["comment_id"].combine_chunks())
    )
    return rows.set_column(
        rows.column_names.index("depth"), "depth", pc.coalesce(rows["depth"], known)
    )


def _reason(state: str, gone: str | None) -> str | None:
    if state != "there":
        return "missing" if state in ("missing", "stub") else "malformed"
    return gone
