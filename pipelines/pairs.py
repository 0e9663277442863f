"""Video-text pairs (MineDojo paper, data collection appendix, "video-text pairs"; 640K pairs
there).

A list of keywords is matched in the transcripts of the kept videos. Each match is extended at
random to 16–77 CLIP tokens; a random moment within the match's cues is the centre of a clip of
8–16 s. The profile decides what the paper leaves open: whole words, rules for everyday words, and
which of a video's overlapping clips are kept.

    tables     transcripts → pairs/pairs-*.parquet, with the scores of pairs that have not changed,
               and what second tracks and judgements say → pairs/measures.json
    measure    second tracks of a sample of videos → pairs/measures.json
    export     pairs/ → release/pairs/, without text, or export/<format>/
"""

from typing import Any

from kb.artifacts.measures import check_pairs, write_measure
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.labels.imports import measure_labels
from kb.pairs import measures
from kb.pairs.build import build, required_keywords
from kb.pairs.measures import VideoSample
from kb.registry import PUBLISHED
from kb.score.build import put_back
from kb.store.tables.columns import word_count
from kb.youtube.crawl.second_tracks import (
    fetch_second_tracks,
    has_second_tracks,
    not_fetched,
    plan_second_tracks,
    with_both,
)
from kb.youtube.parse.assemble import second_tracks


def tables_needs(run: Run) -> None:
    """Raises UsageError without keywords, or the extra that matches them."""
    required_keywords(run)


def tables(run: Run) -> Summary:
    """Make the pairs; those that were scored keep their scores."""
    made = build(run)
    put_back(run)
    heard = _heard(run) if has_second_tracks(run.root) else {}
    write_measure(run.root, measures.NAME, heard)
    measure_labels(run)
    return made


def export(run: Run, format: str = "parquet") -> Summary:
    """pairs/ to release/pairs, or to export/<format>."""
    return layouts.export(run, PUBLISHED["pairs"], format)


def measure(run: Run, size: int) -> Summary:
    """Fetch the second tracks of a sample of videos, and write what they say of the pairs.

    Raises FatalError without pairs, Stopped with `summary` when tracks are left to fetch.
    """
    sample = _sample(run, size)
    fetched = fetch_second_tracks(run, sample.ids)
    section = _heard(run)
    path = write_measure(run.root, measures.NAME, section)
    return Summary(
        fetched,
        videos_with_both_tracks=sample.out_of,
        videos_compared=section["videos_compared"],
        speech_recognition=section,
        path=str(path),
    )


def _heard(run: Run) -> dict[str, Any]:
    """What all second tracks that are there say of the pairs."""
    every = _sample(run)
    left = set(not_fetched(run.root, every.ids))
    sample = every._replace(ids=[video for video in every.ids if video not in left])
    tracks = second_tracks(run.root, sample.ids, word_count)
    return measures.measured(run.root, tracks, required_keywords(run), sample, run.seed)


def plan_measure(run: Run, size: int) -> Summary:
    """What `measure` would fetch. Sends and writes nothing."""
    sample = _sample(run, size)
    return Summary(plan_second_tracks(run, sample.ids), videos_with_both_tracks=sample.out_of)


def _sample(run: Run, size: int | None = None) -> VideoSample:
    required_keywords(run)
    check_pairs(run.root)
    return measures.sampled(run.root, with_both(run), size, run.seed)
