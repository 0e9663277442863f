"""What of YouTube's raw answers must go: videos that vanished, and named ones."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts.restore import WORK
from kb.core.context import Run
from kb.core.verdict import Summary
from kb.crawl import purge
from kb.crawl.purge import PurgeKeys
from kb.store import purge_plan, rawlog
from kb.store.layout import BELOW, Layout
from kb.store.purge import RowLocation, links_of, place_of, verdicts_of
from kb.store.purge_search import finder
from kb.youtube.connector.ids import read_ids
from kb.youtube.connector.reduce import (
    RAW_STATISTICS,
    RAW_TRANSCRIPTS,
    RAW_VIDEOS,
    REFRESH,
    STATISTICS,
    TRANSCRIPTS,
    VIDEOS,
)
from kb.youtube.connector.source import YouTubeSource
from kb.youtube.parse import answers as parse

ROWS = (
    *(place_of(f"youtube/{name}", "video_id") for name in ("videos", "transcripts")),
    *verdicts_of("youtube"),
    place_of("pairs/pairs", "video_id"),
    links_of("youtube"),
    *(
        RowLocation(str(BELOW.restored("youtube", name)), f"youtube/{name}", "video_id")
        for name in ("videos", "transcripts")
    ),
    RowLocation(str(BELOW.restored("youtube")), "shared/missing", "key"),
    RowLocation(str(BELOW.restored("pairs")), "pairs/pairs", "video_id"),
    RowLocation(str(BELOW.restored()), "shared/missing", "key"),
)


def collect(run: Run, named: Collection[str]) -> dict[str, str]:
    """What is to go and why: "vanished" are those that the API no longer returns, or "named"."""
    return dict.fromkeys(vanished(run.root), "vanished") | dict.fromkeys(named, "named")


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge youtube` would remove, counted. Changes nothing."""
    named, said = _named(run, ids)
    strip = purge.strip_of("youtube")
    counts = purge_plan.plan(run.root, "youtube", collect(run, named), strip, ROWS, finder)
    return Summary(counts, **said)


def purge_raw(run: Run, ids: Path | None) -> PurgeKeys:
    """Tombstones, raw segments and frontier; the keys that must leave everything else as well.

    Raises SettingError before anything is written.
    """
    named, said = _named(run, ids)
    keys = purge.purge_raw(
        run,
        YouTubeSource(run),
        lambda session: PurgeKeys(collect(run, named), said),
        kinds=(VIDEOS, TRANSCRIPTS, REFRESH, STATISTICS),
        exact=(RAW_VIDEOS, RAW_TRANSCRIPTS, RAW_STATISTICS),
    )
    if keys:
        # Answers of a restoration that was cut off; it asks again.
        shutil.rmtree(Layout(run.root).restored("youtube", WORK), ignore_errors=True)
    return keys


def _named(run: Run, ids: Path | None) -> tuple[list[str], dict[str, int]]:
    """The keys of a file, and what is said of it."""
    if ids is None:
        return [], {}
    named, bad_lines = read_ids(ids, run.progress.say)
    return named, {"bad_lines": bad_lines}


class _Item(msgspec.Struct, gc=False):
    id: Any = None


class _Items(msgspec.Struct, gc=False):
    items: list[_Item] = []


class _Answer(msgspec.Struct, gc=False):
    """Of an envelope, which videos were asked for and returned."""

    fetched_at: str | None
    request: rawlog.Request
    response: _Items


def vanished(root: Path) -> set[str]:
    """Videos whose newest answer leaves them out."""
    newest: dict[str, tuple[str, bool]] = {}
    decoder = msgspec.json.Decoder(_Answer)
    for path in rawlog.segments(root, "youtube", RAW_VIDEOS):
        for _, line in rawlog.Frames(path, checked=True):
            at, params, gone = _not_returned(decoder, line)
            for key in parse.requested(params):
                if newest.get(key, ("", False))[0] <= at:
                    newest[key] = (at, key in gone)
    return {key for key, (_, gone) in newest.items() if gone}


def _not_returned(
    decoder: msgspec.json.Decoder[_Answer], line: bytes
) -> tuple[str, dict[str, Any], set[str]]:
    """When an answer was read, what was asked for, and which of it did not come back."""
    try:
        quick = decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):  # of another form: looked at in full
        envelope = rawlog.decode(line)
        params = envelope.request.params
        return envelope.fetched_at or "", params, set(parse.missing(params, envelope.response))
    params = quick.request.params
    there = {item.id for item in quick.response.items if isinstance(item.id, str)}
    return quick.fetched_at or "", params, set(parse.requested(params)) - there
