"""Builds an artifact in parts; a run that was stopped goes on with the parts that are left.

    state/<name>/<digest>/plan.json        what workers need to know to make a part
    state/<name>/<digest>/<part>.parquet   the rows of a finished part
    state/<name>/<digest>/<part>.json      its figures, written before its rows
    <name>/_manifest.json                  written last; then the parts are removed

The digest covers the inputs and the plan: parts made from anything else are removed, never used.
"""

import contextlib
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts import freshness, manifest
from kb.artifacts.manifest import Build, Manifest
from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.engine import executor_of, map_in_order
from kb.schema import table
from kb.store.artifact_registry import ARTIFACTS
from kb.store.atomic import write_text
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.tables.shard_writer import write_table

_PLAN = "plan.json"


class Part(NamedTuple):
    """A piece of work. `arguments` are what the function that makes it is called with, after the
    folder and the name; `size` is how much it counts in the progress.
    """

    name: str
    arguments: tuple[Any, ...]
    size: int = 1


class PartedBuild:
    """An artifact that is made in parts, in the data root or in the workplace of a download.

    `plan` is everything besides the inputs that decides the rows. Call it under the artifact's
    lock.
    """

    def __init__(
        self, run: Run, name: str, inputs: Mapping[str, str], plan: Mapping[str, Any]
    ) -> None:
        self._run, self._name, self._inputs = run, name, dict(inputs)
        self._plan = json.dumps(plan, sort_keys=True)
        self._settings, rules = freshness.settings(run, name), ARTIFACTS[name].rules
        self.root = Catalog(run.root.absolute()).workplace
        decides = json.dumps([self._inputs, self._settings, rules, self._plan], sort_keys=True)
        digest = hashlib.sha256(decides.encode()).hexdigest()
        self.folder = Layout(self.root).state_folder(name) / digest[:16]

    def known(self) -> Manifest | None:
        """The manifest of the artifact as it is; None for one to be made anew with `again`."""
        return None if self._run.again else manifest.read(self.root, self._name)

    def is_current(self) -> bool:
        """Whether the artifact is complete and made from the same inputs and plan; then nothing is
        left of its parts. Raises DamagedData where a file of it is missing.
        """
        known = self.known()
        if known is None or known.figures.get("made_in") != self.folder.name:
            return False
        if not known.figures.get("complete", True):
            return False
        manifest.check_complete(self.root, self._name)
        self._clear(())
        return True

    def begin(self) -> None:
        """Remove the parts that can't be used, and write the plan. Raises DiskFull."""
        self._clear(() if self._run.again else (self.folder,))
        write_text(self.folder / _PLAN, self._plan)

    def _clear(self, kept: Sequence[Path]) -> None:
        for folder in self.folder.parent.glob("*"):
            if folder not in kept:
                shutil.rmtree(folder, ignore_errors=True)

    def make(
        self,
        parts: Sequence[Part],
        make_part: Callable[..., dict[str, int]],
        unit: str,
        inputs: Iterable[Path],
    ) -> None:
        """Make the parts that are not there yet, `inputs` in all. `make_part` is called in workers,
        ends with `write_part`, and returns counts that the progress sums up. Raises Interrupted.
        """
        todo = [one for one in parts if not (self.folder / f"{one.name}.parquet").exists()]
        run, counts = self._run, dict[str, int]()
        size = sum(path.stat().st_size for path in inputs) if todo else 0
        with (
            run.progress.task(self._name, total=sum(one.size for one in todo), unit=unit) as task,
            executor_of(run, size) as executor,
        ):
            tasks = ((str(self.folder), one.name, *one.arguments) for one in todo)
            made = map_in_order(executor, make_part, tasks, window=executor.window)
            for part, more in zip(todo, made, strict=True):
                counts = {name: counts.get(name, 0) + number for name, number in more.items()}
                task.advance(part.size, **counts)

    @property
    def rows(self) -> list[Path]:
        """The rows of all finished parts."""
        return parquet_files(self.folder)

    def figures(self) -> Iterator[Any]:
        """The figures of all finished parts."""
        for path in self.rows:
            yield json.loads(path.with_suffix(".json").read_text())

    @contextlib.contextmanager
    def finish(self, *, complete: bool = True) -> Iterator[Build]:
        """A fresh folder that takes the artifact's place, with its manifest. The parts are removed
        unless it is incomplete. Raises DiskFull.
        """
        with manifest.replacing(
            self.root, self._name, inputs=self._inputs, settings=self._settings
        ) as build:
            yield build
            build.figures = {"complete": complete, "made_in": self.folder.name, **build.figures}
        if complete:
            shutil.rmtree(self.folder)


def write_part(
    folder: str, name: str, rows: Sequence[pa.Table], declared: str, figures: object
) -> None:
    """Write a finished part: its figures, then its rows. Raises DiskFull."""
    write_text(Path(folder, f"{name}.json"), json.dumps(figures))
    complete = pa.concat_tables(rows) if rows else table(declared).arrow().empty_table()
    write_table(Path(folder, f"{name}.parquet"), complete, declared)


def read_plan(folder: str) -> Any:
    """The plan of the parts in a folder."""
    return json.loads(Path(folder, _PLAN).read_text())


def clear_finished(root: Path, name: str) -> None:
    """Remove parts that a run, killed right after its last step, had not removed.

    Parts of an unfinished build stay: the next run resumes from them. Raises WriterLocked.
    """
    known = manifest.read(root, name)
    if known is None or not (known.figures.get("complete") and known.figures.get("made_in")):
        return
    parts = Layout(root).state_folder(name) / str(known.figures["made_in"])
    if parts.exists():
        with writer(root, ARTIFACTS[name].lock):
            shutil.rmtree(parts, ignore_errors=True)
