"""Lists the export formats of what is published, with the function that writes each, and writes
Parquet: clean/<source> → release/<source>, the released columns of every released table, sorted.

The folder is written anew and takes the old one's place whole, so nothing of an older release
(checksums, card, shards) stays beside new data. What `schemas/` does not release never leaves
clean/: columns by `released`, whole tables (transcripts) as well.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pyarrow as pa

from kb.artifacts import domain_binding, freshness, manifest
from kb.artifacts.table_catalog import Catalog
from kb.artifacts.texts import exported_files
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import Summary, vocabulary
from kb.schema.tables import released_tables
from kb.store.artifact_registry import ARTIFACTS, exports_in
from kb.store.layout import Layout
from kb.store.tables import shard_writer
from kb.store.tables.checksums import FileEntry

Writer = Callable[..., Any]


class Exported(Protocol):
    """What is published under a name."""

    name: str

    def writers(self) -> Mapping[str, Writer]:
        """The writers of its layouts; of Parquet where tables are not all of it."""


def export(run: Run, published: Exported, layout: str = "parquet", **options: Any) -> Summary:
    """One layout, with its own options: what was written. Raises FatalError when there is nothing
    to export, DamagedData, DiskFull, WriterLocked.
    """
    name = published.name
    writers: dict[str, Writer] = {
        "parquet": partial(write_parquet, source=name),
        **published.writers(),
    }
    places = exports_in(layout, name, options)
    owners = filter(None, (name, PUBLISHED[name].part_of))
    with domain_binding.writing(run, *(f"release-{owner}" for owner in owners)):
        find = partial(exported_files, Catalog(run.root.absolute()))
        inputs = {artifact: manifest.inputs(run.root, artifact, find) for artifact in places}
        for artifact in places:  # until it is written, nothing is known of it
            ARTIFACTS[artifact].manifest(run.root).unlink(missing_ok=True)
        made = writers[layout](run, **options)
        for artifact in places:
            place = ARTIFACTS[artifact].folder(run.root)
            every = [place] if place.is_file() else place.rglob("*")
            there = [path for path in every if path.is_file()]
            files = {str(path.relative_to(place)): FileEntry(path.stat().st_size) for path in there}
            as_made = manifest.new_manifest(
                artifact, inputs[artifact], freshness.settings(run, artifact), files, options
            )
            manifest.write_manifest(ARTIFACTS[artifact].manifest(run.root), as_made)
    if not isinstance(made, Summary):
        return Summary(format=layout, export=str(made))
    return Summary(
        {"command": f"{name} export" if name in SOURCES else name, "source": name} | made
    )


class RowTransform(NamedTuple):
    """How released rows differ from clean ones: a function of a piece of rows,
    and the clean columns that it reads.
    """

    make: Callable[[pa.Table], pa.Table]
    reads: Sequence[str] = ()


def write_parquet(
    run: Run,
    source: str,
    *,
    changes: Mapping[str, RowTransform] | None = None,
    add_files: Callable[[Path], None] | None = None,
) -> Summary:
    """Writes release/<source>/ and returns the rows of each table.

    `changes` by table name ("wiki/pages"); `add_files` adds files that are not tables to the fresh
    folder before it takes its place. Raises FatalError when there is nothing to export, and
    DiskFull. The same clean rows give the same bytes.
    """
    at = Layout(run.root)
    released = released_tables(source)
    files = {declared.name: manifest.rows(run.root, declared.name) for declared in released}
    if not any(files.values()):
        place = at.table(released[0].name)
        raise FatalError(
            f"nothing to export: {place.parent if source in SOURCES else place} has no rows",
            hint=f"run `{ARTIFACTS[ARTIFACTS[f'release/{source}'].inputs[0]].command}` first",
        )
    name = f"release/{source}"
    made_from = manifest.inputs(run.root, name)
    summary: dict[str, int] = {}
    size = run.profile.release.shard_mb * 1e6
    folder = Layout(run.root.absolute()).release(source)
    with (
        run.progress.task(f"export {source}", total=len(released), unit="tables") as task,
        manifest.replacing(
            run.root.absolute(), name, inputs=made_from, settings=freshness.settings(run, name)
        ) as build,
    ):
        fresh = build.folder
        for declared in released:
            change = (changes or {}).get(declared.name)
            if change is not None:
                # What the change knows is in this process only.
                made = shard_writer.sorted_shards(
                    files[declared.name],
                    fresh,
                    declared,
                    shard_bytes=size,
                    reads=change.reads,
                    change=change.make,
                )
                summary[declared.short] = sum(shard.rows for shard in made)
                task.advance(1, rows=summary[declared.short])
        plain = [declared for declared in released if declared.name not in (changes or {})]
        tasks = (
            (
                declared.name,
                [str(path.absolute()) for path in files[declared.name]],
                str(fresh),
                size,
            )
            for declared in plain
        )
        # One sort a table is bound by the disk: on one machine a pool would gain nothing.
        with make_executor(run.engine, 1, run.scheduler, run.root) as executor:
            for declared, rows in zip(
                plain,
                map_in_order(executor, write_shards, tasks, window=len(released)),
                strict=True,
            ):
                summary[declared.short] = rows
                task.advance(1, rows=rows)
        if add_files is not None:
            add_files(fresh)
    return Summary(
        command=f"{source} export" if source in SOURCES else source,
        source=source,
        **{name: summary[name] for name in sorted(summary, key=vocabulary.place)},
        path=str(folder),
    )


def write_shards(name: str, parts: Sequence[str], folder: str, shard_bytes: float) -> int:
    """One table's shards; how many rows. Runs in a worker."""
    made = shard_writer.sorted_shards(
        [Path(part) for part in parts],
        Path(folder),
        name,
        shard_bytes=shard_bytes,
    )
    return sum(shard.rows for shard in made)
