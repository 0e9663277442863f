"""What of YouTube's raw answers must go: videos that vanished, and named ones."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.crawl import purge
from kb.crawl.purge import Keys
from kb.store import purge_plan, rawlog
from kb.store.layout import BELOW, Layout
from kb.store.purge import Place, place_of, verdicts_of
from kb.youtube import parse
from kb.youtube.ids import read_ids
from kb.youtube.reduce import RAW_TRANSCRIPTS, RAW_VIDEOS, REFRESH, TRANSCRIPTS, VIDEOS
from kb.youtube.restored import WORK
from kb.youtube.source import YouTube

ROWS = (
    *(place_of(f"youtube/{name}", "video_id") for name in ("videos", "transcripts")),
    *verdicts_of("youtube"),
    place_of("pairs/pairs", "video_id"),
    *(
        Place(str(BELOW.restored("youtube", name)), f"youtube/{name}", "video_id")
        for name in ("videos", "transcripts")
    ),
    Place(str(BELOW.restored("youtube")), "shared/missing", "key"),
    Place(str(BELOW.restored("pairs")), "pairs/pairs", "video_id"),
    Place(str(BELOW.restored()), "shared/missing", "key"),
)


def collect(run: Run, named: Collection[str]) -> dict[str, str]:
    """What is to go and why: "vanished" are those that the API no longer returns, or "named"."""
    return dict.fromkeys(vanished(run.root), "vanished") | dict.fromkeys(named, "named")


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge youtube` would remove, counted. Changes nothing."""
    named, said = _named(ids)
    strip = purge.strip_of("youtube")
    counts = purge_plan.plan(run.root, "youtube", collect(run, named), strip, ROWS)
    return Summary(counts, **said)


def purge_raw(run: Run, ids: Path | None) -> Keys:
    """Tombstones, raw segments and frontier; the keys that must leave everything else as well.

    Raises SettingError before anything is written.
    """
    named, said = _named(ids)
    keys = purge.purge_raw(
        run,
        YouTube(run),
        lambda session: Keys(collect(run, named), said),
        kinds=(VIDEOS, TRANSCRIPTS, REFRESH),
        exact=(RAW_VIDEOS, RAW_TRANSCRIPTS),
    )
    if keys:
        # Answers of a restoration that was cut off; it asks again.
        shutil.rmtree(Layout(run.root).restored("youtube", WORK), ignore_errors=True)
    return keys


def _named(ids: Path | None) -> tuple[list[str], dict[str, int]]:
    """The keys of a file, and what is said of it."""
    if ids is None:
        return [], {}
    named, bad_lines = read_ids(ids)
    return named, {"bad_lines": bad_lines}


def vanished(root: Path) -> set[str]:
    """Videos whose newest answer leaves them out."""
    newest: dict[str, tuple[str, bool]] = {}
    for path in rawlog.segments(root, "youtube", RAW_VIDEOS):
        for _, line in rawlog.Frames(path):
            envelope = rawlog.decode(line)
            gone = set(parse.missing(envelope.request.params, envelope.response))
            for key in parse.requested(envelope.request.params):
                at = envelope.fetched_at or ""
                if newest.get(key, ("", False))[0] <= at:
                    newest[key] = (at, key in gone)
    return {key for key, (_, gone) in newest.items() if gone}
