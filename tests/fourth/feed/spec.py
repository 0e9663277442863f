"""What the feed declares to the rest of Lorecrawl."""

from kb.core.source_spec import ReleaseSpec, ReportSpec, SourceSpec, TextColumns

SPEC = SourceSpec(
    name="feed",
    package=__package__,
    help="Notes of a feed: crawl, filter, export.",
    tables={"notes": ""},
    nouns={"pages": "pages", "notes": "notes"},
    counted="notes",
    connector=".connector:Feed",
    section=".section:FeedSection",
    texts=(TextColumns("notes", "note_id", {"body": ("text",)}),),
    passages=".passages:passages",
    indexed=("notes",),
    release=ReleaseSpec("notes", "SELECT count(*) FROM feed_notes", stages=("likes",)),
    report=ReportSpec("Feed", ("feed/notes",), "run `kb feed crawl`, then `kb feed filter`"),
)
