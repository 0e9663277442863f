"""Lists the export formats of what is published, with the function that writes each."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from kb.artifacts import freshness, manifest
from kb.core.context import Run
from kb.core.errors import FatalError, MissingExtra, ProfileError
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import Summary
from kb.export import parquet
from kb.store.artifact_registry import ARTIFACTS
from kb.store.layout import Layout
from kb.store.tables.checksums import FileEntry

Writer = Callable[..., Any]


def writers(name: str) -> Mapping[str, Writer]:
    """The layouts of what is published under that name."""
    return {"parquet": partial(parquet.export, source=name), **PUBLISHED[name].writers()}


def export(run: Run, name: str, layout: str = "parquet", **options: Any) -> Summary:
    """One layout, with its own options: what was written. Raises FatalError when there is nothing
    to export, DamagedData, DiskFull.
    """
    places = [one for one in ARTIFACTS if freshness.made_from(one) == name]
    places = [one for one in places if one.startswith(f"export/{layout}")]
    inputs = {one: manifest.inputs(run.root, one) for one in places}
    for one in places:  # until it is written, nothing is known of it
        ARTIFACTS[one].manifest(run.root).unlink(missing_ok=True)
    made = writers(name)[layout](run, **options)
    for one in places:
        there = ARTIFACTS[one].folder(run.root).exists()
        files = {".": FileEntry()} if there else {}
        as_made = manifest.of(one, inputs[one], freshness.settings(run, one), files, options)
        manifest.write(ARTIFACTS[one].manifest(run.root), as_made)
    if not isinstance(made, Summary):
        return Summary(format=layout, export=str(made))
    return Summary(
        {"command": f"{name} export" if name in SOURCES else name, "source": name} | made
    )


def export_again(run: Run, name: str) -> None:
    """Every layout that is there, of today's rows. Raises as `export`."""
    at, made = Layout(run.root), PUBLISHED[name].exports
    for layout, writer in writers(name).items():
        places = [one for one in made if one.partition("/")[0] == layout]
        if any(at.export(one).exists() for one in places):
            writer(run, **_options(run, places))
        elif layout == "parquet" and at.release(name).exists():
            writer(run)


def rebuild(run: Run, name: str, what: str, make: Callable[[Run], Any]) -> None:
    """Make existing tables and their layouts again; delete the tables that can't be made."""
    folder = ARTIFACTS[name].folder(run.root)
    if not folder.exists():
        return
    try:
        make(run)
    except (MissingExtra, ProfileError, FatalError) as error:
        shutil.rmtree(folder)
        shutil.rmtree(Layout(run.root).release(name), ignore_errors=True)
        run.progress.say(f"the {what} were removed: {error}; `kb {name}` makes them again")
    else:
        export_again(run, name)


def _options(run: Run, places: Sequence[str]) -> dict[str, Any]:
    """The options with which a layout was made."""
    made = [manifest.read(run.root, f"export/{one}") for one in places]
    options = next((dict(one.figures) for one in made if one is not None), {})
    if "tokenizer" in options and not Path(options["tokenizer"]).is_file():
        del options["tokenizer"]  # then words are counted
    return options
