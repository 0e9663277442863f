"""Raw answers of a reconstruction → restored tables.

Rows of one post meet in one bucket, so one bucket bounds the memory.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection, Mapping
from datetime import datetime
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts.restore import (
    FOREVER,
    MISSING,
    PURGED,
    WORK,
    MissingReason,
    RestoredTable,
    RestoreFolder,
    fresh_rows,
)
from kb.core import clock
from kb.core.errors import SettingError
from kb.reddit.crawl.ids import Released, WantedThings
from kb.reddit.dumps.cursor import KIND
from kb.reddit.parse import answers as parse
from kb.reddit.parse.answer_tree import depths
from kb.reddit.parse.assemble import assemble, newest_of, parent_comments, with_counts
from kb.reddit.section import Links
from kb.schema.tables import Table
from kb.store.exhausted import full_disk_is_resumable
from kb.store.rawlog import rawlog
from kb.store.tables.columns import aligned, newest, put
from kb.store.tables.partition import Shuffle

TABLES = (RestoredTable("reddit/posts", "t3_"), RestoredTable("reddit/comments", "t1_"))
DONE = ".done.json"  # which lists of ids were answered, and how many rows the tables have
_PART = re.compile(r"part-\d{5,}\.parquet\Z")


def folder_of(out: Path) -> RestoreFolder:
    return RestoreFolder(out, TABLES, "post_id", "reddit/missing", rows_per_bucket=200_000)


def check_place(out: Path) -> None:
    """Raise SettingError where writing the tables would delete files that are not theirs."""
    if out.exists() and not out.is_dir():
        raise SettingError(f"--out {out} is not a folder", hint="give a folder")
    ours = (out / DONE).exists() or (out / MISSING).exists() or any(out.glob(f"{WORK}-*"))
    for place in (out / table.declared.short for table in TABLES):
        if place.is_dir() and not place.is_symlink():
            entries = sorted(place.iterdir())
        else:
            entries = [place] if place.exists() or place.is_symlink() else []
        for path in entries:
            if not (ours and _PART.match(path.name) and path.is_file()):
                raise SettingError(
                    f"--out: {path} was not made by a reconstruction and would be deleted",
                    hint="give another folder",
                )


class Answers(NamedTuple):
    """What one run has: `unanswered` full name → reason; `released` fills in what no answer says.

    `purged` are tombstones, `people` stands for authors who asked to be left out. `otherwise` is
    the reason of names that no answer mentions.
    """

    work: Path
    wanted: WantedThings
    released: Released
    purged: Collection[str] = ()
    people: Collection[str] = ()
    otherwise: str = "missing"
    unanswered: Mapping[str, str] = {}


def add_answers(answers: Answers, out: Path, links: Links) -> dict[str, int]:
    """Add the answers to the tables below `out`; rows of each. Other runs may have written newer
    rows meanwhile: times decide. Raises DamagedData, DiskFull.
    """
    wanted, work, folder = answers.wanted, answers.work, folder_of(out)
    buckets = folder.buckets(len(wanted.names) + 50 * len(wanted.trees))
    scratch = work / "rows"
    with full_disk_is_resumable(work):
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        _partition(work, scratch, buckets, links)
        now = clock.now()
        reasons = {key: MissingReason(reason, now) for key, reason in answers.unanswered.items()}
        for number in range(buckets):
            reasons |= _answered(scratch, number, answers)
        reasons |= dict.fromkeys(answers.purged, MissingReason(PURGED, FOREVER))
        return folder.merge(
            scratch,
            buckets,
            reasons,
            chain(wanted.names, (f"t3_{key}" for key in wanted.trees)),
            newer=False,
            unlisted=answers.purged,
            otherwise=answers.otherwise,
            finish=partial(_finished, people=pa.array(sorted(answers.people), pa.string())),
        )


def _partition(work: Path, scratch: Path, buckets: int, links: Links) -> None:
    """Rows of all raw answers → `scratch/<bucket>/<kind>.arrow`, by post where it is known."""
    for kind in rawlog.kinds(work, "reddit"):
        lines = (
            line
            for path in rawlog.segments(work, "reddit", kind)
            for _, line in rawlog.Frames(path)
        )
        with Shuffle(scratch, kind, buckets) as shuffle:
            for rows in parse.rows(lines, kind, links):
                unknown = pc.equal(pc.fill_null(rows["post_id"], ""), "")
                shuffle.add_rows(rows, pc.if_else(unknown, rows["fullname"], rows["post_id"]))


def _answered(scratch: Path, number: int, answers: Answers) -> dict[str, MissingReason]:
    """Write the fresh rows of a bucket; the reasons of things without one."""
    answered = {
        kind: _read(path)
        for kind in parse.KINDS
        if (path := scratch / str(number) / f"{kind}.arrow").exists()
    }
    reasons: dict[str, MissingReason] = {}
    if not answered:
        return reasons
    made = assemble(answered)
    for table in TABLES:
        rows = _complete(made[table.name], table.declared, reasons)
        if table.declared.short == "posts":
            # Nobody read the tree of a post that was asked for by its id alone.
            trees = pc.is_in(rows["post_id"], pa.array(answers.wanted.trees, pa.string()))
            unread = pc.if_else(trees, rows["comments_unread"], pa.scalar(None, pa.int64()))
            rows = put(rows, "comments_unread", unread)
            rows = _filled(rows, "post_id", "comments_unread", answers.released.unread)
        else:
            rows = _filled(rows, "comment_id", "depth", answers.released.depths)
            posts = [name[3:] for name in answers.purged if name.startswith("t3_")]
            rows = rows.filter(pc.invert(pc.is_in(rows["post_id"], pa.array(posts, pa.string()))))
        path = fresh_rows(scratch, number, table.declared.short)
        with pa.ipc.new_file(str(path), rows.schema) as file:
            file.write_table(rows)
    return reasons


def _finished(rows: dict[str, pa.Table], people: pa.Array[Any]) -> dict[str, pa.Table]:
    """The rows of all runs without those of people who asked to be left out, with depths that no
    run alone could know, and counts.
    """
    rows = {
        name: part.filter(pc.invert(pc.is_in(part["author_hash"].cast(pa.string()), people)))
        for name, part in rows.items()
    }
    comments = rows["reddit/comments"]
    keys = cast("list[str]", comments["comment_id"].to_pylist())
    known = depths(zip(keys, comments["parent_id"].to_pylist(), strict=True))
    computed = pa.array([known.get(key) for key in keys], pa.int64())
    comments = put(comments, "depth", pc.coalesce(comments["depth"], computed))
    # Rows that an older version restored have none.
    comments = put(comments, "parent_comment_id", parent_comments(comments["parent_id"]))
    return with_counts({**rows, "reddit/comments": comments})


def _read(path: Path) -> pa.Table:
    with pa.ipc.open_file(str(path)) as file:
        rows = file.read_all()
    if path.stem == KIND:
        rows = newest(rows, ["fullname"], parse.COPIES)
    return newest_of({"info": rows})


def _complete(rows: pa.Table, declared: Table, missing: dict[str, MissingReason]) -> pa.Table:
    """The rows that have all required columns; reasons of the others are added to `missing`."""
    states = cast("list[str]", rows["state"].to_pylist())
    reasons = [
        why if state == "there" else "missing" if state in ("missing", "stub") else "malformed"
        for state, why in zip(states, rows["gone"].to_pylist(), strict=True)
    ]
    for column in declared.columns:
        if not column.nullable and column.name in rows.column_names:
            valid = rows[column.name].is_valid().to_pylist()
            reasons = [
                why or (None if is_valid else "malformed")
                for why, is_valid in zip(reasons, valid, strict=True)
            ]
    dated = pc.if_else(rows["undated"], None, rows["fetched_at"])
    times = cast("list[datetime | None]", dated.to_pylist())
    names = cast("list[str]", rows["fullname"].to_pylist())
    for name, reason, at in zip(names, reasons, times, strict=True):
        if reason is not None:
            missing[name] = MissingReason(reason, at)
    kept = rows.filter(pa.array([reason is None for reason in reasons], pa.bool_()))
    for field in declared.arrow():
        if field.name not in kept.column_names:
            kept = kept.append_column(field.name, pa.nulls(kept.num_rows, field.type))
    return kept.select(declared.names())


def _filled(rows: pa.Table, key: str, name: str, known: pa.Table | None) -> pa.Table:
    """The column `name` where it is null from `known` (key, name)."""
    if known is None:
        return rows
    return put(rows, name, pc.coalesce(rows[name], aligned(known, key, rows[key])[name]))
