"""YouTube (MineDojo paper, appendix "YouTube": data collection and filtering).

1. search channels by keywords; 2. list every video that each channel uploaded; 3. read their
metadata, keep the domain's game; 4. English transcripts of those that pass the cheap stages; 5.
drop by views, aspect ratio, duration, age restriction; score titles and descriptions with Detoxify,
drop above the threshold. Released: ids and metadata only.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, cast

from kb.annotate import toxicity
from kb.annotate.words import word_count_of_lists
from kb.core.context import Run
from kb.core.profile import Profile
from kb.core.verdict import Summary
from kb.export import minedojo, parquet
from kb.filters.chain import Chain, Clean, Follow
from kb.filters.judgement import Predicate
from kb.filters.predicates import AtLeast, AtMost, In, NotTrue, RatioAtLeast, passes
from kb.filters.topic import Topic
from kb.filters.transcripts import required
from kb.store.buckets import Kind
from kb.youtube import parse
from kb.youtube.assemble import assemble, unanswered


def gate(p: Profile) -> tuple[Predicate, ...]:
    """What a video of the profile's categories must pass before its transcript is worth three
    requests.
    """
    return (
        AtLeast("view_count", p.section("youtube").min_views, stage="views"),
        RatioAtLeast(
            "width", "height", p.section("youtube").min_aspect_ratio, stage="aspect_ratio"
        ),
        AtLeast("duration_s", p.section("youtube").min_duration_s, stage="duration"),
        NotTrue("age_restricted", stage="age_restricted", reason="age_restricted"),
    )


def crawl(run: Run, only: str | None, ids: Path | None, part: tuple[int, int] | None) -> Summary:
    """Channels, uploads, metadata and transcripts, as raw answers."""
    from kb.youtube.source import crawl

    return crawl(run, partial(promising, run.profile), only=only, ids=ids, part=part)


def promising(p: Profile, videos: Any) -> list[str]:
    """Of videos as parsed, the ids that are worth asking for a transcript: of the categories,
    and through the gate.
    """
    rows = assemble({"videos": videos}, words=word_count_of_lists)["youtube/videos"]
    stages: tuple[Predicate, ...] = (
        NotTrue("missing", stage="missing", reason="missing"),
        In("category_id", p.section("youtube").category_ids, stage="topic"),
        *gate(p),
    )
    return cast("list[str]", rows.filter(passes(stages, rows))["video_id"].to_pylist())


def clean(p: Profile) -> Clean:
    """Raw answers to videos and transcripts, stages in the paper's order."""
    limit, helpers = (
        p.toxicity.threshold("youtube"),
        ("missing", "game_label_id", "game_label", "transcript_outcome"),
    )
    scored = {"title": "toxicity_title", "description": "toxicity_description"}
    stages: tuple[Predicate, ...] = (
        NotTrue("missing", stage="missing", reason="missing"),
        Topic(
            p.section("youtube").game_ids,
            p.section("youtube").category_ids,
            p.section("youtube").words,
            gate(p),
        ),
        *gate(p),
        *(
            AtMost(column, limit, stage="toxicity", null_passes=True, reason=text)
            for text, column in scored.items()
            if limit is not None
        ),
        *(required() if p.section("youtube").transcripts == "required" else ()),
    )
    return Clean(
        source="youtube",
        kinds={
            "videos": Kind(parse.videos, key=("video_id",), bucket="video_id"),
            "transcripts": Kind(
                parse.transcripts, key=("video_id",), bucket="video_id", prefer="final"
            ),
        },
        assemble=partial(assemble, words=word_count_of_lists),
        chains=(
            Chain(
                "youtube/videos",
                "video_id",
                stages,
                scores=scored,
                helpers=helpers,
                told=("title", "channel_id", "channel_title"),
            ),
        ),
        follow=(Follow("youtube/transcripts", of="youtube/videos", on="video_id"),),
        scorer=toxicity,
        unanswered=unanswered,
    )


def export(run: Run, format: str) -> Summary:
    """Clean to release/youtube, or to export/minedojo."""
    return minedojo.youtube(run) if format == "minedojo" else parquet.export(run, "youtube")
