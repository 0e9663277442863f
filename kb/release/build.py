"""`kb release`: the gate, then everything around the data of each folder.

release(run)     gate → describe each folder → gate over what was written
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import orjson
import pyarrow as pa
from duckdb import DuckDBPyConnection

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.release_folder import (
    KEYWORDS,
    OVERVIEW,
    TOMBSTONES,
    ReleasedTable,
    ReleaseFolder,
    read_release_folder,
    tombstone_lines,
)
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.errors import NotReleasable, ReleaseRefused, UsageError
from kb.core.licences import KNOWN
from kb.core.sources import PUBLISHED, SELECTIONS, SOURCES, made_of
from kb.core.summary import Summary
from kb.release import folders, provenance
from kb.release.folders import sample_name
from kb.release.gate import GateProblem, check
from kb.release.metadata import measure
from kb.release.metadata.card import card, citation, datasheet, law
from kb.release.metadata.croissant import croissant
from kb.release.metadata.measure import Facts, MeasuredPublication
from kb.release.metadata.overview import overview
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
    if unlicensed := [
        export.source for export in exports if not measure.folder_licence(run, export)
    ]:
        raise _unsigned(run.profile, unlicensed)
    with domain_binding.writing(run, *RELEASES):
        refuse(check.check(run, exports))
        for folder in exports:
            freshness.settle_purged(run, folder.name)
        facts = [write(run, folder, published[folder.source]) for folder in exports]
        refuse(
            check.check_made(
                run, [read_release_folder(folder.path, folder.source) for folder in exports]
            )
        )
        write_overview(run)
        freshness.note_described(run, (folder.name for folder in exports))
    return Summary(
        command="release",
        folders=len(exports),
        rows=sum(folder.rows for folder in facts),
        bytes=sum(folder.size for folder in facts),
        sandbox_model="yes, not for publication"
        if any(folder.sandbox for folder in facts)
        else None,
        sources={
            folder.source: {table.table.short: table.rows for table in folder.tables}
            for folder in facts
        },
    )


def write_overview(run: Run) -> None:
    """README.md above all folders that are described."""
    if text := overview(run.profile, folders.in_root(run.root)):
        write_text(Layout(run.root).release() / OVERVIEW, text)


def refuse_unsigned(profile: Profile, names: Collection[str]) -> None:
    """Raise NotReleasable unless the profile names a contact, a creator and these licences."""
    unlicensed = profile.release.unlicensed(name for name in PUBLISHED if name in names)
    if unlicensed or profile.release.unsigned():
        raise _unsigned(profile, unlicensed)


def _unsigned(profile: Profile, unlicensed: Sequence[str]) -> NotReleasable:
    lacking = [f"no licence of {', '.join(unlicensed)}"] if unlicensed else []
    lacking += [field.replace("a ", "no ", 1) for field in profile.release.unsigned()]
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
            if source not in there and manifest.read_manifest(run.root, f"release/{source}")
        ]
    )
    if not exports:
        raise ReleaseRefused(
            f"there is nothing to release under {at.release()}",
            hint=f"run an export first, such as `kb {next(iter(SOURCES))} export`",
        )
    if strange := sorted(set(only) - there):
        raise UsageError(
            f"there is no folder {', '.join(strange)} in {at.release()}",
            hint=f"exported: {', '.join(folder.source for folder in exports)}",
        )
    exports = [folder for folder in exports if folder.source in wanted]
    stale = freshness.stale(run, *(f"release/{folder.name}" for folder in exports))
    for folder in [one for one in exports if f"release/{one.name}" in stale]:
        # What was selected is made again by nobody but its maker, who may want it as it was.
        if folder.source in SELECTIONS and folder.source not in only:
            name = f"release/{folder.name}"
            why, again = ", ".join(stale.pop(name)), ARTIFACTS[name].command
            run.progress.say(f"{name} is left out, as it is out of date: {why}; run `{again}`")
            exports.remove(folder)
    refuse(
        [
            GateProblem("out of date", name, ", ".join(why))
            for name, why in stale.items()
            if not all(
                reason.endswith(("is missing", "is damaged")) for reason in why
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
        removed = [
            tombstones.tombstone_rows(run.root, source).select(columns)
            for source in made_of(folder.source)
        ]
        write_text(folder.path / TOMBSTONES, tombstone_lines(pa.concat_tables(removed)))
        write_samples(folder, run.profile.release.sample_mb)
        write_text(folder.path / SUMS, listed(folder.files()))
        provenance.record(run.root, folder, facts, version)
        task.advance(3)
        return facts


_SAMPLED = 20  # rows of a sample: it is for reading
_CANDIDATES = 1_000  # keys among which those that fit are looked for


def write_samples(folder: ReleaseFolder, megabytes: float) -> list[Path]:
    """<table>.sample.json for each table, of at most 20 rows and together at most `megabytes`: a
    JSON list with a row a line, times in ISO 8601. No Parquet: whoever reads `*.parquet` would have
    these rows twice.

    The tables of a folder share a column (a pair, a page, a post). All samples have the same values
    of it: first those that most of the tables have, in the order of their MD5, so that the sample
    is spread over the data and the same each time. A table without that column shows its first
    rows.
    """
    shared = _shared(folder.parts)
    with database.asking() as con:
        having = tuple(part for part in folder.parts if shared in part.table.names(released=True))
        keys = _fitting(con, having, shared)
        while True:
            written = [_sample(con, folder, part, shared, keys) for part in folder.parts]
            if sum(path.stat().st_size for path in written) <= megabytes * 1e6 or len(keys) < 2:
                return written
            keys = keys[: len(keys) // 2]


def _fitting(con: DuckDBPyConnection, parts: Sequence[ReleasedTable], shared: str) -> list[Any]:
    """Values of the column, as many as have at most 20 rows in each table, and one at least."""
    counted = " UNION ALL ".join(
        f'SELECT {number} AS part, "{shared}" AS key, count(*) AS n FROM read_parquet(${number})'
        " GROUP BY ALL"
        for number in range(1, len(parts) + 1)
    )
    rows = con.execute(
        f"SELECT key, map_from_entries(list((part, n))) FROM ({counted}) GROUP BY key"
        f" ORDER BY count(*) DESC, md5(key::VARCHAR) LIMIT {_CANDIDATES}",
        [[str(shard) for shard in part.shards] for part in parts],
    ).fetchall()
    keys: list[Any] = []
    totals: Counter[int] = Counter()
    for key, counts in rows:
        if all(totals[part] + n <= _SAMPLED for part, n in counts.items()):
            keys.append(key)
            totals.update(counts)
    return keys or [key for key, _ in rows[:1]]


def _sample(
    con: DuckDBPyConnection, folder: ReleaseFolder, part: ReleasedTable, shared: str, keys: Any
) -> Path:
    by = ", ".join(f'"{name}"' for name in order(part.table))
    has = shared in part.table.names(released=True)
    fits = f't."{shared}" IN (SELECT unnest($2))' if has else "len($2) > 0"
    limit = _SAMPLED if has else f"least({_SAMPLED}, len($2))"
    rows = con.sql(
        f"SELECT t.* FROM read_parquet($1) t WHERE {fits} ORDER BY {by} LIMIT {limit}",
        params=[[str(shard) for shard in part.shards], keys],
    ).to_arrow_table()
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
    """The column that is the key of all tables of the folder, else one that all have and that is
    the key of a source's table; else the main one's first key.
    """
    first = parts[0].table.key
    if len(first) == 1 and all(part.table.key == first for part in parts):
        return first[0]
    source = parts[0].table.source
    for name in (
        table(f"{one}/{short}").key[0] for one in SOURCES for short in SOURCES[one].tables
    ):
        if all(name in part.table.names(released=True) for part in parts):
            return name
    own = next((part for part in parts if part.table.short == PUBLISHED[source].main), parts[0])
    return own.table.key[0]
