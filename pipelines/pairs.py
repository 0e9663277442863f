"""Video-text pairs (MineDojo paper, data collection appendix, "video-text pairs"; 640K pairs
there).

A list of keywords is matched in the transcripts of the kept videos. Each match is extended at
random to 16–77 CLIP tokens; a random moment within the match's cues is the centre of a clip of
8–16 s. The profile decides what the paper leaves open: whole words, rules for everyday words, and
which of a video's overlapping clips are kept.

    tables     transcripts → pairs/pairs-*.parquet, with the scores of pairs that have not changed
    measure    second tracks of a sample of videos → pairs/measures.json
    export     pairs/ → release/pairs/, without text, or export/<format>/
"""

from kb.artifacts.measures import check_pairs, write_measure
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.pairs import measures
from kb.pairs.build import build, required_keywords
from kb.pairs.keywords import Keywords
from kb.pairs.measures import VideoSample
from kb.registry import PUBLISHED
from kb.score.build import put_back
from kb.store.tables.columns import word_count
from kb.youtube.crawl.second_tracks import (
    fetch_second_tracks,
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
    return made


def export(run: Run, format: str = "parquet") -> Summary:
    """pairs/ to release/pairs, or to export/<format>."""
    return layouts.export(run, PUBLISHED["pairs"], format)


def measure(run: Run, size: int) -> Summary:
    """Fetch the second tracks of a sample of videos, and write what they say of the pairs.

    Raises FatalError without pairs, Stopped with `summary` when tracks are left to fetch.
    """
    sample, keywords = _sample(run, size)
    fetched = fetch_second_tracks(run, sample.ids)
    tracks = second_tracks(run.root, sample.ids, word_count)
    section = measures.measured(run.root, tracks, keywords, sample, run.seed)
    path = write_measure(run.root, measures.NAME, section)
    return Summary(
        fetched,
        videos_with_both_tracks=sample.out_of,
        videos_compared=section["videos_compared"],
        speech_recognition=section,
        path=str(path),
    )


def plan_measure(run: Run, size: int) -> Summary:
    """What `measure` would fetch. Sends and writes nothing."""
    sample, _ = _sample(run, size)
    return Summary(plan_second_tracks(run, sample.ids), videos_with_both_tracks=sample.out_of)


def _sample(run: Run, size: int) -> tuple[VideoSample, Keywords]:
    keywords = required_keywords(run)
    check_pairs(run.root)
    return measures.sampled(run.root, with_both(run), size, run.seed), keywords
