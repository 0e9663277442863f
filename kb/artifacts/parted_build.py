"""Builds an artifact in parts, side by side in workers.

    <name>/.parts/plan.json        what workers need to know to make a part
    <name>/.parts/<part>.parquet   the rows of a finished part
    <name>/.parts/<part>.json      its figures

The parts lie in the fresh folder that takes the artifact's place, and are removed before it does.
"""

import contextlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts import freshness, manifest
from kb.artifacts.manifest import Build
from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.engine import executor_of, map_in_order
from kb.schema import table
from kb.store.atomic import write_text
from kb.store.layout import parquet_files
from kb.store.tables.shard_writer import write_table

_PLAN = "plan.json"


class Part(NamedTuple):
    """A piece of work. `arguments` are what the function that makes it is called with, after the
    folder and the name; `size` is how much it counts in the progress.
    """

    name: str
    arguments: tuple[Any, ...]
    size: int = 1


class PartedBuild(NamedTuple):
    """An artifact that is being made: `build` as `manifest.replacing` gives it, and the `folder` of
    its parts.
    """

    run: Run
    name: str
    build: Build
    folder: Path

    def make_parts(
        self,
        parts: Sequence[Part],
        make_part: Callable[..., dict[str, int]],
        unit: str,
        inputs: Iterable[Path],
    ) -> None:
        """Make the parts out of these files. `make_part` is called in workers, ends with
        `write_part`, and returns counts that the progress sums up. Raises Interrupted.
        """
        counts = dict[str, int]()
        size = sum(path.stat().st_size for path in inputs)
        with (
            self.run.progress.task(
                self.name, total=sum(part.size for part in parts), unit=unit
            ) as task,
            executor_of(self.run, size) as executor,
        ):
            tasks = ((str(self.folder), part.name, *part.arguments) for part in parts)
            made = map_in_order(executor, make_part, tasks, window=executor.window)
            for part, more in zip(parts, made, strict=True):
                counts = {name: counts.get(name, 0) + number for name, number in more.items()}
                task.advance(part.size, **counts)

    @property
    def rows(self) -> list[Path]:
        """The rows of all parts."""
        return parquet_files(self.folder)

    def figures(self) -> Iterator[Any]:
        """The figures of all parts."""
        for path in self.rows:
            yield json.loads(path.with_suffix(".json").read_text())


def is_current(run: Run, name: str) -> bool:
    """Whether an artifact needs not be made, as nothing that it is made of has changed."""
    return not run.again and not freshness.reasons(run, name)


@contextlib.contextmanager
def parted_build(
    run: Run, name: str, inputs: Mapping[str, str], plan: Mapping[str, Any]
) -> Iterator[PartedBuild]:
    """A fresh folder that takes the artifact's place when the block ends well, in the data root or
    in the workplace of a download. `plan` is what workers need to know.

    Call it under the artifact's lock. Raises DiskFull.
    """
    root = Catalog(run.root.absolute()).workplace
    settings = freshness.settings(run, name)
    with manifest.replacing(root, name, inputs=inputs, settings=settings) as build:
        parts = build.folder / ".parts"
        write_text(parts / _PLAN, json.dumps(plan, sort_keys=True))
        yield PartedBuild(run, name, build, parts)
        shutil.rmtree(parts)


def write_part(
    folder: str, name: str, rows: Sequence[pa.Table], declared: str, figures: object
) -> None:
    """Write a finished part. Raises DiskFull."""
    write_text(Path(folder, f"{name}.json"), json.dumps(figures))
    complete = pa.concat_tables(rows) if rows else table(declared).arrow().empty_table()
    write_table(Path(folder, f"{name}.parquet"), complete, declared)


def read_plan(folder: str) -> str:
    """The plan of the parts in a folder, as JSON: what is made of it can be kept by this text, as
    another build has the same folder.
    """
    return Path(folder, _PLAN).read_text(encoding="utf-8")
