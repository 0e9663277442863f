"""The source YouTube."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, parse_qs

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


class YouTube(Source):
    """Videos and transcripts."""

    name = "youtube"
    help = "Videos and transcripts: crawl, import, filter, export."
    tables = {"videos": ""}
    nouns = {
        "searches": "searches",  # pages of channel searches
        "uploads": "channels",  # channels whose uploads are listed
        "videos": "videos",  # videos whose metadata is read
        "transcripts": "transcripts",  # videos whose transcript is fetched
        "statistics": "statistics to refresh",  # videos whose counts are read again
        "refresh": "videos to refresh",  # videos that are read again in full
        "second_tracks": "second tracks",  # automatic tracks that a sample compares
    }
    counted = "videos"
    noted = ("channels",)
    unfiltered = ("second_tracks", "seeds")
    crawl_settings = (
        "keywords",
        "search_pages",
        "uploads",
        "transcripts_per_hour",
        "max_age_days",
        "max_tries",
        "searches_per_day",
        "units_per_day",
    )
    credential = "youtube_api_key"
    keyless = "transcripts"
    waiting = {
        "transcript": "run `kb youtube crawl` or import transcripts, YouTube's or your own (`kb"
        " youtube missing-transcripts` lists the videos); with"
        ' `transcripts = "optional"` in [youtube] of the profile they are kept without',
    }
    refreshed = "refresh"
    restored = True
    linked = ("videos", "transcripts")
    indexed = ("videos", "transcripts")
    textual = ("transcripts", "videos")
    exports = (
        "minedojo/youtube_full.json",
        "minedojo/youtube_tutorial.json",
        "text/youtube.jsonl",
    )
    main = "videos"
    query = (
        "SELECT transcript_kind, count(*) AS videos, round(sum(duration_s) / 3600) AS hours"
        " FROM youtube_videos GROUP BY ALL ORDER BY videos DESC"
    )
    stages = (
        "missing",
        "not_public",
        "topic",
        "views",
        "aspect_ratio",
        "duration",
        "age_restricted",
        "toxicity",
        "transcript",
    )
    rules = (
        "youtube.keywords",
        "youtube.topic_keywords",
        "youtube.game_ids",
        "youtube.category_ids",
        "youtube.imported_topic",
        "youtube.search_pages",
        "youtube.uploads",
        "youtube.min_views",
        "youtube.min_aspect_ratio",
        "youtube.min_duration_s",
        "youtube.transcripts",
        "youtube.language",
        "youtube.translate",
        "youtube.own_transcripts",
    )
    ways = {
        "searched": RecordedWay(raw="search"),
        "listed": RecordedWay(raw="playlist_items"),
        "api": RecordedWay("metadata_origin", "api", ages=True),
        "files": RecordedWay("metadata_origin", "file"),
        "meant": RecordedWay("topic_evidence", "profile"),
        "watched": RecordedWay("read_from", "watch_page", raw="transcripts"),
        "subtitles": RecordedWay("read_from", "file", raw="ytdlp_subtitles"),
        "own_transcripts": RecordedWay("transcript_origin", "own"),
    }
    title = "YouTube"
    shown = ("youtube/videos",)
    totals = (
        ("videos", "youtube/videos", "count(*)"),
        ("hours of video", "youtube/videos", "sum(duration_s) / 3600"),
        ("years of video", "youtube/videos", "sum(duration_s) / 3600 / 24 / 365.25"),
        ("words spoken", "youtube/videos", "sum(word_count)"),
    )
    hint = "run `kb youtube crawl`, then `kb youtube filter`"
    sampled = {
        "youtube/videos": (
            "title",
            "view_count",
            "like_count",
            "duration_s",
            "transcript_kind",
            "published_at",
        )
    }
    only = "only videos"
    ref = "youtube:VIDEO@61"
    mark = "@"
    hosts = (".youtube.com",)
    dated = ("published_at", "published")
    annotate_help = "Score titles and descriptions of crawled videos."
    annotate_examples = ("kb annotate youtube                     titles and descriptions",)
    purge_help = (
        "Remove videos that are gone from YouTube or are named, and never collect them again."
    )
    purge_examples = (
        "kb purge youtube",
        "kb purge youtube --ids gone.txt",
        "kb purge youtube --channels channels.txt --plan",
    )

    def connector(self, run: Run) -> Connector:
        from kb.youtube.crawl.connector import YouTubeConnector

        return YouTubeConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.youtube.crawl.client import question

        return question(run, cost)

    def crawled(self, frontier: Frontier) -> int:
        from kb.youtube.crawl.reduce import crawled

        return crawled(frontier)

    def status(self, run: Run, frontier: Frontier) -> dict[str, Any]:
        from kb.youtube.status import status

        return status(run, frontier)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns, in_transcripts

        if table == "transcripts":
            return in_transcripts(path)
        return in_columns(path, "video_id", {"title": ("title",), "body": ("description",)})

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.youtube.passages import passages

        return passages(profile, root)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from kb.youtube.documents import document

        return document(tables, place)

    def place_of(self, url: SplitResult) -> tuple[str, str] | None:
        query = parse_qs(url.query)
        at = query.get("t", [""])[0].removesuffix("s")
        return (query["v"][0], at) if "v" in query else None

    def address(self, key: str) -> str:
        return f"https://www.youtube.com/watch?v={key}"

    def figures(self) -> Sequence[FigureMaker]:
        from kb.youtube.report import FIGURES

        return FIGURES

    def origin(self, profile: Profile) -> str:
        return "https://www.youtube.com/"

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.youtube.card import gaps

        return gaps(con, root, folder)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text

        return {"minedojo": minedojo.youtube, "text": partial(text.export, source=self.name)}

    def text_documents(self, files: Mapping[str, str], origin: str) -> Iterator[TextDocument]:
        from kb.youtube.text import documents

        return documents(files)

    def purge_rules(self) -> PurgeRules:
        from kb.youtube.purge import RULES

        return RULES
