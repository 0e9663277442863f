"""Purge (MineDojo paper, datasheet: maintenance, "if others want to be removed").

What was deleted at its source, or named, leaves every folder for good; what was made of it is made
again.

    raw        tombstones, raw answers, frontier: the source's own
    index      removed; the next search makes it again
    clean      rows of tables, of rejected, failed and pending; pairs, links
    scores     annotations of texts that no row has any more
    made       release/, export/, links/ and report/ as far as they are there
"""

from __future__ import annotations

import importlib
import shutil
from pathlib import Path
from types import ModuleType

from kb.annotate.scores import drop_unused
from kb.artifacts import belonging, indexed, manifest
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.pipeline import load, locate
from kb.core.verdict import Summary
from kb.export import layouts
from kb.filters.clean import texts
from kb.release.build import describe
from kb.report.build import report_again
from kb.store import lock
from kb.store import purge as store
from kb.store.layout import Layout


def purge(run: Run, source: str, ids: Path | None) -> Summary:
    """Everything, in the order above, while nobody else writes what it touches.

    Cut off, the same command goes on.
    """
    with belonging.writing(run, *lock.of_purge(source)):
        room = _room(source)
        clean = f"clean/{source}"
        current = manifest.is_current(run.root, clean)
        keys = room.purge_raw(run, ids)
        said, rows, scores = getattr(keys, "said", {}), 0, 0
        if keys:
            indexed.forget(run.root, source)
            with manifest.editing(run.root, clean, "pairs", "links"):
                rows = store.drop_rows(run.root, source, room.ROWS, keys)
                if hasattr(room, "mend"):
                    room.mend(run.root, keys)
            if current:  # what was removed left raw/ and clean/ alike
                manifest.note_inputs(run.root, clean)
            with manifest.editing(run.root, f"annotations/{source}"):
                scores = drop_unused(run.root, source, texts(run, source))
            _made(run, source)
        named = sum(reason != "post" for reason in keys.values()) - said.get("unknown", 0)
        counts = {"purged": named, "rows": rows, "scores": scores, **said}
        summary = Summary(command=f"purge {source}", source=source, **counts)
        try:
            store.finish(run.root, source)
        except DamagedData as error:
            error.summary = summary
            raise
    return summary


def plan(run: Run, source: str, ids: Path | None) -> Summary:
    """What would go, counted by table and folder. Changes nothing."""
    summary: Summary = _room(source).plan(run, ids)
    return summary


def _room(source: str) -> ModuleType:
    return importlib.import_module(f"kb.{source}.purge")


def _made(run: Run, source: str) -> None:
    """Exports are written again from clean, and everything around them; what can't is removed."""
    layouts.export_again(run, source)
    if source == "youtube":
        shutil.rmtree(Layout(run.root).pairing, ignore_errors=True)
        layouts.export_again(run, "pairs")
    load(str(locate("links"))).again(run)
    describe(run, [source, "pairs", "links"])
    report_again(run)
