"""What Reddit declares to the rest of Lorecrawl."""

from kb.core.source_spec import (
    AgentSpec,
    CommandHelp,
    ReleaseSpec,
    ReportSpec,
    SourceSpec,
    TextColumns,
)

SPEC = SourceSpec(
    name="reddit",
    package=__package__,
    help="Posts and comments: crawl, import, filter, export, reconstruct.",
    tables={"posts": "t3_", "comments": "t1_"},
    nouns={
        "listing": "listings",  # listings of posts
        "tree": "posts",  # posts that are read with their comments
        "more": "further comments",  # comments that a post's page only names
        "thread": "deep threads",  # threads that go on on a page of their own
        "info": "posts and comments to refresh",  # those that are read again
    },
    counted="posts",
    refreshed="info",
    credential="reddit_client_id",
    connector=".connector.source:RedditSource",
    purge=".purge:RULES",
    commands="kb.cli.commands.sources.reddit",
    section="kb.core.config.profile.reddit:RedditSection",
    status=".status",
    online=".connector.online:question",
    formats={
        "minedojo": "kb.export.minedojo:reddit",
        "convokit": "kb.export.convokit:export",
    },
    exports=("minedojo/reddit.json", "convokit"),
    texts=(
        TextColumns(
            "posts", "post_id", {"title": ("title",), "body": ("body", "poll_options")}, "t3_"
        ),
        TextColumns("comments", "comment_id", {"comment": ("body",)}, "t1_"),
    ),
    passages="kb.search.reddit_passages:passages",
    indexed=("posts", "comments"),
    restored=("posts", "comments"),
    release=ReleaseSpec(
        origin="https://www.reddit.com/r/{subreddit}/",
        main="posts",
        counted=("posts", "comments"),
        query="SELECT type, count(*) AS posts, sum(comments_released) AS comments"
        " FROM reddit_posts GROUP BY ALL ORDER BY posts DESC",
        stages=("missing", "post", "removed", "nsfw", "score", "toxicity"),
        rules=("subreddit", "search", "listings", "spans", "min_score"),
        gaps=("kb.release.metadata.gaps:threads", "kb.release.metadata.gaps:unread"),
        ids_only=True,
    ),
    report=ReportSpec(
        title="Reddit",
        tables=("reddit/posts", "reddit/comments"),
        hint="run `kb reddit crawl` or `kb reddit import FILE`, then `kb reddit filter`",
        figures="kb.report.sources:REDDIT",
        samples={"reddit/posts": ("title", "type", "score", "num_comments", "created_utc")},
        only="only threads",
        color="blue",
    ),
    agent=AgentSpec(
        time=("created_utc", "written"),
        reader="kb.mcp.reddit:document",
        link="kb.mcp.reddit:from_link",
        ref="reddit:POST/COMMENT",
        between="/",
        hosts=(".reddit.com",),
        note="texts are their authors', Reddit gives no licence",
        prefixes=("t3_", "t1_"),
        item="https://www.reddit.com/comments/{key}/",
    ),
    annotate_help=CommandHelp(
        "Score titles, bodies and comments.",
        (
            "kb annotate reddit --precision int8     faster; exact near the threshold",
            "kb annotate reddit --engine dask --scheduler tcp://10.0.0.1:8786",
        ),
    ),
    purge_help=CommandHelp(
        "Remove posts and comments that were deleted or are named, and never collect them again.",
        ("kb purge reddit", "kb purge reddit --ids requests.txt"),
    ),
)
