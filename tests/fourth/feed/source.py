"""The feed, a fourth source."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from kb.core.source import Source

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.config.section import Section
    from kb.core.context import Run
    from kb.crawl.connector import Connector
    from kb.links.texts import TextPart
    from kb.search.passage import Passage


class Feed(Source):
    """Notes of a feed."""

    name = "feed"
    help = "Notes of a feed: crawl, filter, export."
    tables = {"notes": ""}
    nouns = {"pages": "pages", "notes": "notes"}
    counted = "notes"
    linked = indexed = ("notes",)
    main, query = "notes", "SELECT count(*) FROM feed_notes"
    stages = ("likes",)
    title, shown = "Feed", ("feed/notes",)
    hint = "run `kb feed crawl`, then `kb feed filter`"

    def connector(self, run: Run) -> Connector:
        from kb.feed.connector import FeedConnector

        return FeedConnector(run)

    def section(self) -> type[Section]:
        from kb.feed.section import FeedSection

        return FeedSection

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns

        return in_columns(path, "note_id", {"body": ("text",)})

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.search.passage import Passage, day, plain, rows

        url = profile.section("feed").url
        for note in rows(root, "feed/notes", ["note_id", "text", "fetched_at"]):
            key, date = note["note_id"], day(note["fetched_at"])
            yield Passage("post", key, key, key, plain(note["text"]), f"{url}/notes/{key}", date)
