"""Purge (MineDojo paper, datasheet: maintenance, "if others want to be removed").

What was deleted at its source, or named, leaves every folder for good; what was made of it is made
again.

    raw        tombstones, raw answers, frontier: the source's own
    clean      rows of tables, of rejected, failed and pending; pairs, links
    scores     annotations of texts that no row has any more
    made       release/, export/, links/ and report/ as far as they are there
    index      removed; the next search makes it again
"""

from __future__ import annotations

import importlib
import shutil
from pathlib import Path

import pyarrow as pa

from kb.annotate.hashes import text_hashes
from kb.core.context import Run
from kb.core.errors import DamagedData, FatalError, MissingExtra, ProfileError
from kb.core.pipeline import load, locate
from kb.core.verdict import Summary
from kb.export import clip4mc, minedojo_pairs, parquet, video2dataset
from kb.filters.clean import texts
from kb.links.build import build
from kb.release.build import describe
from kb.report.build import report
from kb.store import indexed, lock
from kb.store import purge as store
from kb.store.layout import Layout


def purge(run: Run, source: str, ids: Path | None) -> Summary:
    """Everything, in the order above, while nobody else writes what it touches.

    Cut off, the same command goes on.
    """
    with lock.taking(run.root, *lock.of_purge(source)):
        return _purge(run, source, ids)


def plan(run: Run, source: str, ids: Path | None) -> Summary:
    """What would go, counted by table and folder. Changes nothing."""
    summary: Summary = importlib.import_module(f"kb.{source}.purge").plan(run, ids)
    return summary


def _purge(run: Run, source: str, ids: Path | None) -> Summary:
    room = importlib.import_module(f"kb.{source}.purge")
    keys = room.purge_raw(run, ids)
    said = getattr(keys, "said", {})
    if keys:
        indexed.forget(run.root, source)  # `kb search` makes it again of what is left
    rows = store.drop_rows(run.root, source, room.ROWS, keys) if keys else 0
    if keys and hasattr(room, "mend"):
        room.mend(run.root, keys)
    scores = _scores(run, source) if keys else 0
    if keys:
        _made(run, source)
    purged = sum(reason != "post" for reason in keys.values()) - said.get("unknown", 0)
    summary = Summary(
        command=f"purge {source}", source=source, purged=purged, rows=rows, scores=scores, **said
    )
    try:
        store.finish(run.root, source)
    except DamagedData as error:
        error.summary = summary
        raise
    return summary


def _scores(run: Run, source: str) -> int:
    """Scores of texts that are still somewhere stay."""
    if not Layout(run.root).annotations(source).is_dir():
        return 0

    hashes = [text_hashes(part) for part in texts(run, source)]
    return store.drop_annotations(
        run.root,
        source,
        pa.chunked_array(hashes, pa.string()).unique() if hashes else pa.array([], pa.string()),
    )


def _links(run: Run) -> None:
    """The entity tables again: a page that is gone may have been an entity's own."""
    at = Layout(run.root)
    shutil.rmtree(at.linking, ignore_errors=True)
    links = load(str(locate("links")))
    try:
        build(run, lambda: links.names(run))
    except (MissingExtra, ProfileError, FatalError) as error:
        shutil.rmtree(at.links)  # what can't be made again does not stay
        shutil.rmtree(at.release("links"), ignore_errors=True)
        run.progress.say(f"the entity tables were removed: {error}; `kb links` makes them again")
    else:
        if at.release("links").exists():
            parquet.export(run, "links")


def _made(run: Run, source: str) -> None:
    """Exports are written again from clean,
    and everything around them; what can't be is removed.
    """
    at = Layout(run.root)
    export = load(str(locate(source))).export
    layouts = {
        "parquet": at.release().glob(source),
        "minedojo": at.export("minedojo").glob(f"{source}*"),
    }
    if source == "reddit":
        layouts["convokit"] = at.export("convokit").glob("*")
    for format, files in layouts.items():
        if any(files):
            export(run, format)
    if source == "youtube":
        shutil.rmtree(at.pairing, ignore_errors=True)
        for files, write in (
            (at.release().glob("pairs"), lambda run: parquet.export(run, "pairs")),
            (at.export("minedojo").glob("pairs.json"), minedojo_pairs.write),
            (at.export("clip4mc").glob("*"), clip4mc.write),
            (at.export("video2dataset").glob("*"), video2dataset.write),
        ):
            if any(files):
                write(run)
    if at.links.exists():
        _links(run)
    describe(run, [source, "pairs", "links"])
    if at.report.exists():
        try:
            report(run)
        except MissingExtra:
            shutil.rmtree(at.report)
