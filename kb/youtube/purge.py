"""What of YouTube's raw answers must go, and how a key leaves them."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path

import msgspec

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.store import lock, mending, purge, purge_plan, rawlog, tombstones
from kb.store.frontier import Frontier
from kb.store.purge import Place
from kb.store.rawlog import Envelope, Request
from kb.store.recorder import Recorder
from kb.youtube import effects, parse
from kb.youtube.effects import REFRESH, TRANSCRIPTS, VIDEOS, Effects
from kb.youtube.ids import read_ids

ROWS = (
    *(
        Place(f"clean/youtube/{name}", f"youtube/{name}", "video_id")
        for name in ("videos", "transcripts")
    ),
    *(
        Place(f"clean/youtube/{verdict}", f"shared/{verdict}", "key")
        for verdict in ("rejected", "failed", "pending")
    ),
    Place("pairs", "pairs/pairs", "video_id"),
)

EXACT = (effects.RAW_VIDEOS, effects.RAW_TRANSCRIPTS)  # raw kinds whose answers are of videos alone


class Keys(dict[str, str]):
    """What a purge removes, key → reason; `said`: what its summary says besides."""

    said: dict[str, int]


def collect(run: Run, named: Collection[str]) -> dict[str, str]:
    """What is to go: videos that the API no longer returns ("vanished"), and named ones ("named")."""
    return dict.fromkeys(vanished(run.root), "vanished") | dict.fromkeys(named, "named")


def plan(run: Run, ids: Path | None) -> Summary:
    """What `kb purge youtube` would remove, counted. Changes nothing."""
    named, bad_lines = read_ids(ids) if ids else ([], 0)
    counts = purge_plan.plan(run.root, "youtube", collect(run, named), strip, ROWS)
    return Summary(counts, **({"bad_lines": bad_lines} if ids else {}))


def vanished(root: Path) -> set[str]:
    """Videos whose newest answer leaves them out."""
    newest: dict[str, tuple[str, bool]] = {}
    for path in rawlog.segments(root, "youtube", effects.RAW_VIDEOS):
        for _, line in rawlog.Frames(path):
            envelope = rawlog.decode(line)
            gone = set(parse.missing(envelope.request.params, envelope.response))
            for key in parse.requested(envelope.request.params):
                at = envelope.fetched_at or ""
                if newest.get(key, ("", False))[0] <= at:
                    newest[key] = (at, key in gone)
    return {key for key, (_, gone) in newest.items() if gone}


def purge_raw(run: Run, ids: Path | None) -> Keys:
    """Tombstones, raw segments and frontier; the keys that must leave everything else as well.

    Raises SettingError before anything is written.
    """
    named, bad_lines = read_ids(ids) if ids else ([], 0)
    with ExitStack() as stack:
        stack.enter_context(lock.writer(run.root, "youtube"))
        frontier = Frontier(run.root / "state" / "youtube.sqlite")
        stack.callback(frontier.close)
        # Opening the recorder sets damage aside, closes segments and takes in what was not read yet.
        known = tombstones.keys(run.root, "youtube")
        Recorder(
            run.root,
            "youtube",
            frontier,
            Effects(run.profile.section("youtube"), lambda rows: (), lambda key: True, known),
            asked=effects.ASKED,
            every=True,
        ).close()
        keys = Keys(purge.begin(run.root, "youtube", collect(run, named)))
        keys.said = {"bad_lines": bad_lines} if ids else {}
        if keys:
            mending.drop_asides(run.root, "youtube", frontier, keys, EXACT)
            purge.rewrite_raw(run.root, "youtube", keys.keys(), strip, frontier)
            for kind in (VIDEOS, TRANSCRIPTS, REFRESH):
                frontier.remove(kind, keys)
        return keys


def strip(kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
    """An envelope without the videos: entries of lists, items and asked ids of metadata, whole transcripts."""
    answer = envelope.response
    if not isinstance(answer, dict):
        return envelope
    if kind == effects.RAW_TRANSCRIPTS:
        return None if answer.get("video_id") in keys else envelope
    if kind == effects.RAW_LIST:
        left = [
            item
            for item in answer.get("items") or []
            if not set(parse.listed({"items": [item]})) & set(keys)
        ]
        if len(left) == len(answer.get("items") or []):
            return envelope
        return msgspec.structs.replace(envelope, response={**answer, "items": left})
    if kind == effects.RAW_VIDEOS:
        asked = parse.requested(envelope.request.params)
        if not set(asked) & set(keys):
            return envelope
        rest = [key for key in asked if key not in keys]
        if not rest:
            return None
        items = [
            item
            for item in answer.get("items") or []
            if not (isinstance(item, dict) and item.get("id") in keys)
        ]
        request = Request(
            envelope.request.endpoint, {**envelope.request.params, "id": ",".join(rest)}
        )
        return msgspec.structs.replace(
            envelope, request=request, response={**answer, "items": items}
        )
    return envelope
