"""Which layouts there are of what, beside the released tables, and what writes each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.export import (
    clip4mc,
    convokit,
    minedojo,
    minedojo_pairs,
    minedojo_reddit,
    minedojo_wiki,
    parquet,
    video2dataset,
    wiki_tar,
)
from kb.store.layout import Layout

Writer = Callable[[Run], Any]

# By what is exported and layout. "parquet" is release/<name>: of the wiki, with tars beside it.
WRITERS: dict[str, dict[str, Writer]] = {
    "youtube": {"minedojo": minedojo.youtube},
    "wiki": {"parquet": wiki_tar.export, "minedojo": minedojo_wiki.wiki},
    "reddit": {"minedojo": minedojo_reddit.export, "convokit": convokit.export},
    "pairs": {
        "minedojo": minedojo_pairs.write,
        "clip4mc": clip4mc.write,
        "video2dataset": video2dataset.write,
    },
}


def writers(name: str) -> dict[str, Writer]:
    """The layouts of what is published under that name."""
    return {"parquet": partial(parquet.export, source=name)} | WRITERS.get(name, {})


def export(run: Run, name: str, layout: str = "parquet") -> Summary:
    """One layout: what was written. Raises FatalError when there is nothing to export, DamagedData,
    DiskFull.
    """
    made = writers(name)[layout](run)
    return made if isinstance(made, Summary) else Summary(format=layout, export=str(made))


def export_again(run: Run, name: str) -> None:
    """Every layout that is there, of today's rows. Raises as `export`."""
    for layout, writer in writers(name).items():
        if any(_places(Layout(run.root), name, layout)):
            writer(run)


def _places(at: Layout, name: str, layout: str) -> Iterator[Path]:
    if layout == "parquet":
        return at.release().glob(name)
    return at.export(layout).glob(f"{name}*" if layout == "minedojo" else "*")
