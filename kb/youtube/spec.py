"""What YouTube declares to the rest of Lorecrawl."""

from kb.core.source_spec import (
    AgentSpec,
    CommandHelp,
    ReleaseSpec,
    ReportSpec,
    SourceSpec,
    TextColumns,
)

SPEC = SourceSpec(
    name="youtube",
    package=__package__,
    help="Videos and transcripts: crawl, import, filter, export.",
    tables={"videos": ""},
    nouns={
        "searches": "searches",  # pages of channel searches
        "uploads": "channels",  # channels whose uploads are listed
        "videos": "videos",  # videos whose metadata is read
        "transcripts": "transcripts",  # videos whose transcript is fetched
        "statistics": "statistics to refresh",  # videos whose counts are read again
        "refresh": "videos to refresh",  # videos that are read again in full
        "second_tracks": "second tracks",  # automatic tracks that a sample compares
    },
    noted=("channels",),
    counted="videos",
    refreshed="refresh",
    connector=".connector.source:YouTubeSource",
    purge=".purge:RULES",
    commands="kb.cli.commands.sources.youtube",
    section="kb.core.config.profile.youtube:YouTubeSection",
    status=".status",
    online=".connector.online:question",
    formats={
        "minedojo": "kb.export.minedojo:youtube",
        "text": "kb.export.flat_text:youtube",
    },
    exports=(
        *("minedojo/youtube_full.json", "minedojo/youtube_tutorial.json"),
        "text/youtube.jsonl",
    ),
    texts=(
        TextColumns("videos", "video_id", {"title": ("title",), "body": ("description",)}),
        TextColumns("transcripts", reader="kb.links.texts:transcripts_of"),
    ),
    passages="kb.search.youtube_passages:passages",
    indexed=("videos", "transcripts"),
    samples=("second_tracks",),
    made=("pairs", "open-text"),
    restored=("videos", "transcripts"),
    release=ReleaseSpec(
        main="videos",
        query="SELECT transcript_kind, count(*) AS videos, round(sum(duration_s) / 3600) AS hours"
        " FROM youtube_videos GROUP BY ALL ORDER BY videos DESC",
        stages=(
            *("missing", "topic", "views", "aspect_ratio", "duration", "age_restricted"),
            *("toxicity", "transcript"),
        ),
        rules=(
            *("keywords", "topic_keywords", "game_ids", "category_ids", "search_pages", "uploads"),
            *("min_views", "min_aspect_ratio", "min_duration_s", "transcripts", "language"),
            "translate",
        ),
        gaps=("kb.release.metadata.gaps:views",),
        scraped=True,
        origin="https://www.youtube.com/",
    ),
    report=ReportSpec(
        title="YouTube",
        tables=("youtube/videos",),
        hint="run `kb youtube crawl`, then `kb youtube filter`",
        figures="kb.report.sources:YOUTUBE",
        samples={
            "youtube/videos": (
                *("title", "view_count", "like_count", "duration_s", "transcript_kind"),
                "published_at",
            )
        },
        only="only videos",
        color="red",
        units=True,
    ),
    agent=AgentSpec(
        time=("published_at", "published"),
        reader="kb.mcp.youtube:document",
        link="kb.mcp.youtube:from_link",
        ref="youtube:VIDEO@61",
        between="@",
        hosts=(".youtube.com",),
        item="https://www.youtube.com/watch?v={key}",
    ),
    annotate_help=CommandHelp(
        "Score titles and descriptions of crawled videos.",
        ("kb annotate youtube                     titles and descriptions",),
    ),
    purge_help=CommandHelp(
        "Remove videos that are gone from YouTube or are named, and never collect them again.",
        (
            "kb purge youtube",
            "kb purge youtube --ids gone.txt",
            "kb purge youtube --plan",
        ),
    ),
)
