"""The source Reddit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult

from kb.core.publication import RecordedWay
from kb.core.source import Source

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.purge import PurgeRules
    from kb.artifacts.release_folder import ReleaseFolder
    from kb.core.config.profile import Profile
    from kb.core.config.profile.base import OnlineAnswer, QuestionCost
    from kb.core.context import Run
    from kb.crawl.connector import Connector
    from kb.export.layouts import Writer
    from kb.export.text import TextDocument
    from kb.links.texts import TextPart
    from kb.mcp.documents import AgentDocument, SourceLocation
    from kb.reader.tables import OpenTables
    from kb.report.figures import FigureMaker
    from kb.search.passage import Passage
    from kb.store.state.frontier import Frontier


class Reddit(Source):
    """Posts and comments of a subreddit."""

    name = "reddit"
    help = "Posts and comments: crawl, import, filter, export, reconstruct."
    tables = {"posts": "t3_", "comments": "t1_"}
    nouns = {
        "listing": "listings",  # listings of posts
        "tree": "posts",  # posts that are read with their comments
        "more": "further comments",  # comments that a post's page only names
        "thread": "deep threads",  # threads that go on on a page of their own
        "info": "posts and comments to refresh",  # those that are read again
    }
    counted = "posts"
    refreshed = "info"
    credential = "reddit_client_id"
    restored = True
    linked = ("posts", "comments")
    indexed = ("posts", "comments")
    crawl_settings = (
        "search",
        "listings",
        "spans",
        "max_age_days",
        "requests_per_minute",
        "max_tries",
    )
    exports = ("minedojo/reddit.json", "text/reddit.jsonl")
    textual = ("posts", "comments")
    main = "posts"
    query = (
        "SELECT type, count(*) AS posts, sum(comments_released) AS comments"
        " FROM reddit_posts GROUP BY ALL ORDER BY posts DESC"
    )
    stages = ("missing", "post", "removed", "nsfw", "score", "toxicity")
    rules = (
        "reddit.subreddit",
        "reddit.search",
        "reddit.listings",
        "reddit.spans",
        "reddit.min_score",
    )
    ways = {
        "dumps": RecordedWay("score_source", "dump"),
        "api": RecordedWay("score_source", "live", ages=True),
    }
    ids_only = True
    title = "Reddit"
    shown = ("reddit/posts", "reddit/comments")
    totals = (
        ("posts", "reddit/posts", "count(*)"),
        ("comments", "reddit/comments", "count(*)"),
    )
    hint = "run `kb reddit crawl` or `kb reddit import FILE`, then `kb reddit filter`"
    sampled = {"reddit/posts": ("title", "type", "score", "num_comments", "created_utc")}
    only = "only threads"
    ref = "reddit:POST/COMMENT"
    mark = "/"
    hosts = (".reddit.com",)
    dated = ("created_utc", "written")
    unlicensed = "texts are their authors', Reddit gives no licence"
    annotate_help = "Score titles, bodies and comments."
    annotate_examples = (
        "kb annotate reddit --precision int8     faster; exact near the threshold",
        "kb annotate reddit --engine dask --scheduler tcp://10.0.0.1:8786",
    )
    purge_help = (
        "Remove posts and comments that were deleted or are named, and never collect them again."
    )
    purge_examples = (
        "kb purge reddit",
        "kb purge reddit --ids requests.txt",
        "kb purge reddit --authors people.txt --plan",
    )

    def connector(self, run: Run) -> Connector:
        from kb.reddit.crawl.connector import RedditConnector

        return RedditConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.reddit.crawl.client import question

        return question(run, cost)

    def crawled(self, frontier: Frontier) -> int:
        from kb.reddit.crawl.reduce import crawled

        return crawled(frontier)

    def incomplete(self, root: Path) -> dict[str, Any]:
        from kb.reddit.status import incomplete

        return incomplete(root)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns

        if table == "comments":
            return in_columns(path, "comment_id", {"comment": ("body",)}, "t1_")
        parts = {"title": ("title",), "body": ("body", "poll_options")}
        return in_columns(path, "post_id", parts, "t3_")

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.reddit.passages import passages

        return passages(profile, root)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from kb.reddit.documents import document

        return document(tables, place)

    def place_of(self, url: SplitResult) -> tuple[str, str] | None:
        match = re.search(r"/comments/(\w+)(?:/[^/]*/(\w+))?", url.path)
        return (match[1], match[2] or "") if match else None

    def bare(self, key: str, at: str) -> tuple[str, str]:
        return key.removeprefix("t3_"), at.removeprefix("t1_")

    def address(self, key: str) -> str:
        return f"https://www.reddit.com/comments/{key}/"

    def figures(self) -> Sequence[FigureMaker]:
        from kb.reddit.report import FIGURES

        return FIGURES

    def origin(self, profile: Profile) -> str:
        section = profile.reddit
        return f"https://www.reddit.com/r/{section.subreddit}/" if section else ""

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.reddit.card import gaps

        return gaps(con, folder)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text

        return {
            "minedojo": minedojo.reddit,
            "text": partial(text.export, source=self.name),
        }

    def text_documents(self, files: Mapping[str, str], origin: str) -> Iterator[TextDocument]:
        from kb.reddit.text import documents

        return documents(files, origin)

    def purge_rules(self) -> PurgeRules:
        from kb.reddit.purge import RULES

        return RULES
