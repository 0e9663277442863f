"""YouTube (MineDojo paper, appendix "YouTube": data collection and filtering).

1. search channels and playlists by keywords; 2. list every video that each channel uploaded
or playlist lists; 3. read their
metadata, keep public videos of the domain's game; 4. English transcripts of those that pass the
cheap stages; 5. drop by views, aspect ratio, duration, age restriction; score titles and
descriptions with Detoxify, drop above the threshold. Released: ids and metadata only.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

from kb.annotate import toxicity
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.summary import Summary
from kb.crawl.share import Part
from kb.export import layouts
from kb.filters.chain import (
    Chain,
    Clean,
    Description,
    Follow,
    GivenUp,
    PurgeKeys,
    RawRows,
)
from kb.filters.predicates import (
    PUBLIC,
    AtLeast,
    In,
    NotTrue,
    Predicate,
    RatioAtLeast,
    none_above,
    rows_passing,
    transcript_required,
)
from kb.registry import PUBLISHED
from kb.store.tables.columns import word_count
from kb.youtube.parse.assemble import HELPERS, KINDS, assemble, unanswered, with_tracks
from kb.youtube.parse.channels import mark
from kb.youtube.parse.playlists import PlaylistTables
from kb.youtube.parse.view_counting import kept_counts
from kb.youtube.section import YouTubeSection
from kb.youtube.topic import Topic, released_stages
from kb.youtube.ytdlp.tracks import TrackLanguage

# What rejected rows keep for readers.
SHOWN = Description(
    {
        **{name: name for name in ("title", "channel_id", "channel_title")},
        "text": "description",
    }
)
SCORES = {"title": "toxicity_title", "description": "toxicity_description"}
THERE = NotTrue("missing", stage="missing", reason="missing")


def crawl(run: Run, only: str | None = None, ids: Path | None = None, part: Part = None) -> Summary:
    """Channels, uploads, metadata and transcripts, as raw answers."""
    from kb.youtube.crawl.connector import crawl

    ours = In("category_id", run.profile.section(YouTubeSection).category_ids, stage="topic")
    return crawl(
        run, partial(rows_passing, (THERE, PUBLIC, ours, *gate(run.profile))), only, ids, part
    )


def gate(p: Profile) -> tuple[Predicate, ...]:
    """What a video of ours must pass before its transcript is worth three requests."""
    least = p.section(YouTubeSection)
    return (
        AtLeast("view_count", least.min_views, "views", "youtube.min_views"),
        RatioAtLeast(
            "width", "height", least.min_aspect_ratio, "aspect_ratio", "youtube.min_aspect_ratio"
        ),
        AtLeast("duration_s", least.min_duration_s, "duration", "youtube.min_duration_s"),
        NotTrue("age_restricted", stage="age_restricted", reason="age_restricted"),
    )


def stages(p: Profile) -> tuple[Predicate, ...]:
    """The paper's, in its order."""
    section, limit = p.section(YouTubeSection), p.toxicity.threshold("youtube")
    return (
        THERE,
        PUBLIC,
        Topic(
            section.game_ids,
            section.category_ids,
            section.words,
            gate(p),
            imported_known=section.imported_topic == "known",
        ),
        *gate(p),
        *none_above(limit, SCORES, "toxicity.thresholds.youtube"),
        *(transcript_required() if section.transcripts == "required" else ()),
    )


def restored(p: Profile, shipped: Clean) -> Clean:
    """The tables of every available video of a release: what is released was judged."""
    stages = released_stages(p.section(YouTubeSection))
    chain = replace(shipped.chains[0], stages=stages, scores={}, described=Description())
    return replace(shipped, chains=(chain,), scorer=None, across=None)


def clean(p: Profile) -> Clean:
    """Raw answers to videos and transcripts."""
    rows = Chain(
        "youtube/videos",
        "video_id",
        stages(p),
        scores=SCORES,
        helpers=HELPERS,
        purged=PurgeKeys(person="channel_id", stands_for=mark),
        described=SHOWN,
    )
    section = p.section(YouTubeSection)
    lists = PlaylistTables(section.playlist_keywords)
    joined = partial(
        assemble,
        words=word_count,
        language=TrackLanguage(section.language, section.translate),
        own=section.own_transcripts,
    )
    return Clean(
        source="youtube",
        raw=RawRows(KINDS, joined),
        chains=(rows,),
        follow=(Follow("youtube/transcripts", of="youtube/videos", on="video_id"),),
        scorer=toxicity,
        given_up=GivenUp(unanswered),
        complete=with_tracks,
        across=lists,
        figures=lambda _, made: {**kept_counts(made), "playlists_left_out": lists.left_out},
    )


def export_open_text(run: Run) -> Summary:
    """Transcripts under an open licence to release/open-text, where the profile asks for it."""
    return layouts.export(run, PUBLISHED["open-text"])
