"""`kb release`: the gate, then everything around the data of each folder.

release(run)     gate → describe each folder → gate over what was written
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import orjson
import pyarrow as pa
from duckdb import DuckDBPyConnection

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.release_folder import (
    KEYWORDS,
    TOMBSTONES,
    ReleasedTable,
    ReleaseFolder,
    read,
    tombstone_lines,
)
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import NotReleasable, ReleaseRefused, UsageError
from kb.core.licences import KNOWN
from kb.core.sources import PUBLISHED, made_of
from kb.core.summary import Summary
from kb.release import folders, provenance
from kb.release.folders import sample_name
from kb.release.gate import GateProblem, check
from kb.release.metadata import measure
from kb.release.metadata.card import card, citation, datasheet, law
from kb.release.metadata.croissant import croissant
from kb.release.metadata.measure import Facts, MeasuredPublication
from kb.release.metadata.zenodo import deposit
from kb.schema import table
from kb.store.artifact_registry import ARTIFACTS, SUMS
from kb.store.atomic import write_text, writing
from kb.store.layout import Layout
from kb.store.lock import RELEASES
from kb.store.state import tombstones
from kb.store.tables import database
from kb.store.tables.checksums import listed
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import order


def release(
    run: Run, published: Mapping[str, MeasuredPublication], only: Sequence[str] = ()
) -> Summary:
    """Check and describe every exported folder, or `only` those of some sources.

    Raises ReleaseRefused with `.problems`, UsageError, NotReleasable.
    """
    refuse_unsigned(run.profile, only or [folder.source for folder in folders.in_root(run.root)])
    exports = exported(run, only)
    if unlicensed := [one.source for one in exports if not measure.folder_licence(run, one)]:
        raise _unsigned(run.profile, unlicensed)
    with domain_binding.writing(run, *RELEASES):
        refuse(check.check(run, exports))
        facts = [write(run, folder, published[folder.source]) for folder in exports]
        refuse(check.check_made(run, [read(folder.path, folder.source) for folder in exports]))
        freshness.note_described(run, (folder.source for folder in exports))
    return Summary(
        command="release",
        folders=len(exports),
        rows=sum(one.rows for one in facts),
        bytes=sum(one.size for one in facts),
        sandbox_model="yes, not for publication" if any(one.sandbox for one in facts) else None,
        sources={
            one.source: {table.table.short: table.rows for table in one.tables} for one in facts
        },
    )


def refuse_unsigned(profile: Profile, names: Iterable[str]) -> None:
    """Raise NotReleasable unless the profile names a contact, a creator and these licences."""
    unlicensed = profile.release.unlicensed(name for name in names if name in PUBLISHED)
    if unlicensed or profile.release.unsigned():
        raise _unsigned(profile, unlicensed)


def _unsigned(profile: Profile, unlicensed: Sequence[str]) -> NotReleasable:
    lacking = [f"no licence of {', '.join(unlicensed)}"] if unlicensed else []
    lacking += [one.replace("a ", "no ", 1) for one in profile.release.unsigned()]
    return NotReleasable(
        f"the profile {profile.path} names {' and '.join(lacking)}",
        hint="set [release.licenses], [[release.creators]] with a name, and release.contact, an"
        " address for removal requests; then run `kb build`",
    )


def exported(run: Run, only: Sequence[str] = ()) -> list[ReleaseFolder]:
    """The folders to release, or `only` those of some sources.

    Raises ReleaseRefused when nothing was exported, a folder that was has lost its data, or
    something that they are made of is out of date; UsageError for a source that was not exported.
    """
    at, exports = Layout(run.root), folders.in_root(run.root)
    there = {folder.source for folder in exports}
    wanted = only or PUBLISHED
    lost = "was exported and is not there; run `{}`, or name the other folders with --only"
    refuse(
        [
            GateProblem(
                "missing",
                str(at.release(source)),
                lost.format(ARTIFACTS[f"release/{source}"].command),
            )
            for source in wanted
            if source not in there and manifest.read(run.root, f"release/{source}")
        ]
    )
    if not exports:
        raise ReleaseRefused(
            f"there is nothing to release under {at.release()}",
            hint="run an export first, such as `kb youtube export`",
        )
    if strange := sorted(set(only) - there):
        raise UsageError(
            f"there is no folder {', '.join(strange)} in {at.release()}",
            hint=f"exported: {', '.join(folder.source for folder in exports)}",
        )
    exports = [folder for folder in exports if folder.source in wanted]
    stale = freshness.stale(run, *(f"release/{folder.source}" for folder in exports))
    refuse(
        [
            GateProblem("out of date", name, ", ".join(why))
            for name, why in stale.items()
            if not all(
                one.endswith(("is missing", "is damaged")) for one in why
            )  # the gate looks at files
        ],
        hint="run `kb build`, which makes what is out of date",
    )
    return exports


def refuse(problems: Sequence[GateProblem], hint: str = "nothing was published") -> None:
    """Raise ReleaseRefused when there are problems; they are in its `summary` as well."""
    if not problems:
        return
    lines = list(dict.fromkeys(str(problem) for problem in problems))
    count = f"{len(lines)} {'reason' if len(lines) == 1 else 'reasons'}"
    error = ReleaseRefused(f"the release is refused for {count}", hint=hint, problems=lines)
    error.summary = Summary(command="release", problems=lines)
    raise error


def write(run: Run, folder: ReleaseFolder, published: MeasuredPublication) -> Facts:
    """Everything around one folder's data, the checksums last."""
    with run.progress.task(f"release {folder.source}", unit="files") as task:
        with reading(shard for part in folder.parts for shard in part.shards):
            facts = measure.measure(run, folder, published)
        for pattern in ("LICENSE-*.txt", folders.RECIPES):
            for path in folder.path.glob(pattern):
                path.unlink()
        version = run.profile.release.version
        changed = provenance.changes(run.root, folder, facts, version)
        texts = {
            "README.md": card(run, facts, changed),
            "DATASHEET.md": datasheet(run, facts),
            "CITATION.cff": citation(run, facts),
            "LICENSE": law(run, facts),
            "croissant.json": croissant(run, facts),
            folders.DEPOSIT: deposit(run, facts),
            **{
                f"LICENSE-{name}.txt": KNOWN[name].text
                for name, _ in facts.licences
                if name in KNOWN and name != facts.licence
            },
            **provenance.files(run, folder.source, changed),
        }
        if KEYWORDS not in texts:
            (folder.path / KEYWORDS).unlink(missing_ok=True)
        for name, text in texts.items():
            write_text(folder.path / name, text)
            task.advance()
        # Keys removed since collection began, of whatever the folder names.
        columns = table("shared/tombstones").names(released=True)
        removed = [tombstones.read(run.root, one).select(columns) for one in made_of(folder.source)]
        write_text(folder.path / TOMBSTONES, tombstone_lines(pa.concat_tables(removed)))
        write_samples(folder, run.profile.release.sample_mb)
        write_text(folder.path / SUMS, listed(folder.files()))
        provenance.record(run.root, folder, facts, version)
        task.advance(3)
        return facts


_GROUPS = 5_000  # groups: a sample is for reading


def write_samples(folder: ReleaseFolder, megabytes: float) -> list[Path]:
    """<table>.sample.json for each table, together at most `megabytes`: a JSON list with a row a
    line, times in ISO 8601. No Parquet: whoever reads `*.parquet` would have these rows twice.

    The tables of a folder share a column (a page, a post, a video). Its values are taken in the
    order of their MD5, so that the sample is spread over the data and the same each time.
    """
    shared = _shared(folder.parts)
    data = sum(shard.stat().st_size for part in folder.parts for shard in part.shards)
    with database.asking() as con:
        lead = next((part for part in folder.parts if part.table.key == (shared,)), folder.parts[0])
        con.execute(
            f'CREATE TEMP TABLE chosen AS SELECT DISTINCT "{shared}" AS k,'
            f' md5("{shared}"::VARCHAR) AS h FROM read_parquet(?) ORDER BY h',
            [[str(shard) for shard in lead.shards]],
        )
        total = con.execute("SELECT count(*) FROM chosen").fetchall()[0][0]
        budget = megabytes * 1e6
        take = min(_GROUPS, max(1, int(total * min(1.0, 0.8 * budget / max(1, data)))))
        while True:
            written = [_sample(con, folder, part, shared, take) for part in folder.parts]
            size = sum(path.stat().st_size for path in written)
            if size <= budget or take == 1:
                return written
            # Few rows compress worse than many: what was too much tells how much is right.
            take = max(1, min(take - 1, int(take * 0.9 * budget / size)))


def _sample(
    con: DuckDBPyConnection, folder: ReleaseFolder, part: ReleasedTable, shared: str, take: int
) -> Path:
    rows = con.sql(
        f'SELECT t.* FROM read_parquet(?) t WHERE t."{shared}" IN (SELECT k FROM chosen'
        f" ORDER BY h LIMIT {take})",
        params=[[str(shard) for shard in part.shards]],
    ).to_arrow_table()
    rows = rows.sort_by([(name, "ascending") for name in order(part.table)])
    path = folder.path / sample_name(part.table)
    columns = [_values(rows[name]) for name in rows.column_names]
    with writing(path) as temporary, temporary.open("wb") as file:
        file.write(b"[")
        for number, row in enumerate(zip(*columns, strict=True)):
            file.write(b",\n" if number else b"\n")
            line = dict(zip(rows.column_names, row, strict=True))
            file.write(orjson.dumps(line, option=orjson.OPT_UTC_Z))
        file.write(b"\n]\n")
    return path


def _values(column: pa.ChunkedArray[Any]) -> list[Any]:
    """Python's values; of a 32-bit number its own digits: 0.12, not 0.11999999731779099."""
    if not pa.types.is_float32(column.type):
        return column.to_pylist()
    return [None if text is None else float(text) for text in column.cast(pa.string()).to_pylist()]


def _shared(parts: tuple[ReleasedTable, ...]) -> str:
    """The column that all tables of the folder have and that is a key of one;
    else the first's first key.
    """
    for name in ("page_id", "post_id", "video_id"):
        if all(name in part.table.names(released=True) for part in parts):
            return name
    return parts[0].table.key[0]
