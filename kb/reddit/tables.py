"""Raw answers of a reconstruction → tables. Rows of one post meet in a bucket, so memory is bounded
by one.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection
from contextlib import ExitStack
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.errors import SettingError
from kb.core.profile.reddit import Links
from kb.reddit import earlier
from kb.reddit.connector.ids import Released, WantedThings
from kb.reddit.dumps.cursor import KIND
from kb.reddit.earlier import DONE, MISSING, NAMES, MissingReason, Verdicts
from kb.reddit.parse import answers as parse
from kb.reddit.parse.assemble import assemble, newest_of
from kb.reddit.parse.comment_counts import counted
from kb.schema.tables import Table, table
from kb.store import database, parquet, rawlog
from kb.store.atomic import full_disk_is_resumable, replacing_folder
from kb.store.shards import write_table
from kb.store.shuffle import Shuffle

IDS = 200_000  # a bucket
WORK = ".work-"
_PART = re.compile(r"part-\d{5,}\.parquet\Z")


def check_place(out: Path) -> None:
    """Raise SettingError where writing the tables would delete what no reconstruction made."""
    if out.exists() and not out.is_dir():
        raise SettingError(f"--out {out} is no folder", hint="give a folder")
    ours = (out / DONE).exists() or (out / MISSING).exists() or any(out.glob(f"{WORK}*"))
    for place in (out / name for name in NAMES):
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


class Answers(NamedTuple):
    """What one run knows: `unanswered` full name → reason; `released` fills in what no answer says.

    `stale`: other runs may have written what is newer than these answers, as always with dumps.
    `purged` are tombstones. `otherwise` is why what nothing is said of is missing.
    """

    work: Path
    wanted: WantedThings
    unanswered: dict[str, str]
    released: Released
    stale: bool = False
    purged: Collection[str] = ()
    otherwise: str = "missing"


def write(answers: Answers, out: Path, links: Links) -> dict[str, int]:
    """Add the answers to posts/, comments/ and missing.parquet below `out`; how many rows each has
    then.

    Each table takes its place whole; killed between two of them, the same again ends the same.
    Raises DamagedData, DiskFull.
    """
    wanted, work = answers.wanted, answers.work
    size = len(wanted.names) + 50 * len(wanted.trees) + earlier.size(out)
    buckets = 1 + size // IDS
    spread = work / "rows"
    with full_disk_is_resumable(work), ExitStack() as folders:
        shutil.rmtree(spread, ignore_errors=True)
        spread.mkdir(parents=True)
        _spread(work, spread, buckets, links)
        earlier.spread(out, spread, buckets)
        gone = {key: MissingReason(reason) for key, reason in answers.unanswered.items()}
        for number in range(buckets):
            gone |= _answered(spread, number, answers)
        gone |= dict.fromkeys(answers.purged, MissingReason("purged", earlier.FOREVER))
        before, newer = earlier.missing(out), not answers.stale
        why = earlier.reasons(before, gone, newer=newer)
        fresh = {name: folders.enter_context(replacing_folder(out / name)) for name in NAMES}
        said = earlier.verdicts(before, gone, newer=newer)
        counts = _write_tables(spread, fresh, buckets, said)
        lost = _lost(spread, fresh, answers, why)
        write_table(out / MISSING, lost, "reddit/missing")
    return {**counts, MISSING: lost.num_rows}


def _answered(spread: Path, number: int, answers: Answers) -> dict[str, MissingReason]:
    """The rows of a bucket that this run got → `spread/new-<name>-<number>.arrow`; why others are
    not there.
    """
    found = {
        kind: _read(path)
        for kind in parse.KINDS
        if (path := spread / str(number) / f"{kind}.arrow").exists()
    }
    if not found:
        return {}
    gone: dict[str, MissingReason] = {}
    made = assemble(found)
    posts = made["reddit/posts"]
    for name, rows in (
        ("posts", posts),
        ("comments", made["reddit/comments"]),
    ):
        kept = _sort(rows, table(f"reddit/{name}"), "t3_" if name == "posts" else "t1_", gone)
        if name == "posts":
            # Of a post that was asked for by its id alone nobody looked for the rest of the tree.
            trees = pc.is_in(kept["post_id"], pa.array(answers.wanted.trees, pa.string()))
            unread = pc.if_else(trees, kept["comments_unread"], pa.scalar(None, pa.int64()))
            kept = _put(kept, "comments_unread", unread)
            kept = _filled(kept, "post_id", "comments_unread", answers.released.unread)
        else:
            kept = _filled(kept, "comment_id", "depth", answers.released.depths)
            posts_gone = [name[3:] for name in answers.purged if name.startswith("t3_")]
            of_gone = pc.is_in(kept["post_id"], pa.array(posts_gone, pa.string()))
            kept = kept.filter(pc.invert(of_gone))
        with pa.ipc.new_file(str(_new(spread, name, number)), kept.schema) as file:
            file.write_table(kept)
    return gone


def _write_tables(
    spread: Path, fresh: dict[str, Path], buckets: int, said: Verdicts
) -> dict[str, int]:
    """Old and new rows, bucket by bucket → part files; how many rows each table has."""
    counts = dict.fromkeys(NAMES, 0)
    for number in range(buckets):
        whole = {}
        for name in NAMES:
            rows = table(f"reddit/{name}").arrow().empty_table()
            if (path := _new(spread, name, number)).exists():
                with pa.ipc.open_file(str(path)) as file:
                    rows = file.read_all()
            whole[f"reddit/{name}"] = earlier.merged(name, number, spread, rows, said)
        whole["reddit/comments"] = earlier.deep(whole["reddit/comments"])
        for name, rows in counted(whole).items():
            short = table(name).short
            if rows.num_rows or not number:  # a first part even where there is nothing
                write_table(fresh[short] / f"part-{number:05d}.parquet", rows, name)
                counts[short] += rows.num_rows
    return counts


def _new(spread: Path, name: str, number: int) -> Path:
    return spread / f"new-{name}-{number}.arrow"


def _lost(
    scratch: Path, made: dict[str, Path], answers: Answers, why: dict[str, MissingReason]
) -> pa.Table:
    """What is in no table and was asked for, or has a reason. All that was asked for stays
    on disk.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    wanted = answers.wanted
    names = chain(wanted.names, (f"t3_{key}" for key in wanted.trees))
    asked = scratch / "asked.parquet"
    with parquet.writing(asked, pa.schema([("key", pa.string())])) as file:
        while part := list(islice(names, IDS)):
            file.write_batch(pa.record_batch({"key": pa.array(part, pa.string())}))
    there = {name: list(folder.iterdir()) for name, folder in made.items()}
    files = [asked, *chain.from_iterable(there.values())]
    with database.over(files, scratch, memory="1GB") as con:
        con.register(
            "reasons",
            pa.table(
                {
                    "key": pa.array(why.keys(), pa.string()),
                    "reason": pa.array([one.reason for one in why.values()], pa.string()),
                    "said_at": pa.array(
                        [None if one.at == earlier.FOREVER else one.at for one in why.values()],
                        pa.timestamp("us", "UTC"),
                    ),
                    # What was purged is named where somebody asks for it, not otherwise.
                    "named": pa.array([key not in answers.purged for key in why], pa.bool_()),
                }
            ),
        )
        missing: pa.Table = con.sql(
            "WITH there AS ("
            " SELECT 't3_' || post_id AS key FROM read_parquet($posts) UNION ALL SELECT"
            " 't1_' || comment_id FROM read_parquet($comments)),"
            " asked AS (SELECT key FROM read_parquet($asked)"
            " UNION SELECT key FROM reasons WHERE named)"
            " SELECT key, coalesce(reason, $otherwise) AS reason, said_at"
            " FROM asked ANTI JOIN there"
            " USING (key) LEFT JOIN reasons USING (key)",
            params={
                "asked": str(asked),
                "otherwise": answers.otherwise,
                **{name: [str(path) for path in paths] for name, paths in there.items()},
            },
        ).to_arrow_table()
        return missing


def _spread(work: Path, spread: Path, buckets: int, links: Links) -> None:
    for kind in rawlog.kinds(work, "reddit"):
        lines = (
            line
            for path in rawlog.segments(work, "reddit", kind)
            for _, line in rawlog.Frames(path)
        )
        with Shuffle(spread, kind, buckets) as shuffle:
            for rows in parse.rows(lines, kind, links):
                # By post where it is known; what was not answered is on its own.
                unknown = pc.equal(pc.fill_null(rows["post_id"], ""), "")
                shuffle.write(rows, pc.if_else(unknown, rows["fullname"], rows["post_id"]))


def _read(path: Path) -> pa.Table:
    with pa.ipc.open_file(str(path)) as file:
        rows = file.read_all()
    if path.stem == KIND:
        rows = _in_order(rows)
    return newest_of({"info": rows})


def _in_order(rows: pa.Table) -> pa.Table:
    """Records of dumps, of which the last one counts where times are equal: a removal rather than
    what was there, then the later dump. A removal that does not say when it was read is newer than
    anything: nothing shows that it was undone.
    """
    gone = pc.is_valid(rows["gone"])
    undated = pc.and_(gone, pc.is_null(rows["fetched_at"]))
    forever = pa.scalar(earlier.FOREVER, rows.schema.field("fetched_at").type)
    rows = _put(rows, "fetched_at", pc.if_else(undated, forever, rows["fetched_at"]))
    rows = rows.append_column("is_gone", gone)
    return rows.sort_by([("is_gone", "ascending"), ("dump", "ascending")]).drop_columns("is_gone")


def _sort(rows: pa.Table, declared: Table, prefix: str, gone: dict[str, MissingReason]) -> pa.Table:
    """The rows that are there and whole, with the table's columns; the rest is noted in `gone`."""
    states = cast("list[str]", rows["state"].to_pylist())
    reasons = [
        _reason(state, why) for state, why in zip(states, rows["gone"].to_pylist(), strict=True)
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
    times = [None if at == earlier.FOREVER else at for at in rows["fetched_at"].to_pylist()]
    names = cast("list[str]", rows["fullname"].to_pylist())
    for name, reason, at in zip(names, reasons, times, strict=True):
        if reason is not None:
            gone[name] = MissingReason(reason, at)  # the reasons of other tables stay
    kept = rows.filter(pa.array([reason is None for reason in reasons], pa.bool_()))
    for field in declared.arrow():
        if field.name not in kept.column_names:
            kept = kept.append_column(field.name, pa.nulls(kept.num_rows, field.type))
    return kept.select(declared.names())


def _filled(rows: pa.Table, key: str, name: str, known: pa.Table | None) -> pa.Table:
    """The column `name` where it is null from `known` (key, name)."""
    if known is None:
        return rows
    place = pc.index_in(rows[key], value_set=known[key].combine_chunks())
    return _put(rows, name, pc.coalesce(rows[name], known[name].take(place)))


def _put(rows: pa.Table, name: str, values: pa.ChunkedArray[Any]) -> pa.Table:
    return rows.set_column(rows.column_names.index(name), name, values)


def _reason(state: str, gone: str | None) -> str | None:
    if state != "there":
        return "missing" if state in ("missing", "stub") else "malformed"
    return gone
