"""The first screen of a card: what to type to have the content, and one picture of what is there.

The picture is text, as a card is read in many places: a bar for each step of the filters, or of
the most frequent keywords.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from kb.release.metadata.facts import ColumnFacts, Facts

WIDTH = 40  # of the longest bar, in characters
# The stages of the filters in their order, posts' and comments' together.
STAGES = {
    "youtube": (
        *("missing", "topic", "views", "aspect_ratio", "duration", "age_restricted", "toxicity"),
        "transcript",
    ),
    "wiki": ("missing", "robots", "render", "words", "toxicity"),
    "reddit": ("missing", "post", "removed", "nsfw", "score", "toxicity"),
}
_QUERIES = {
    "youtube": "SELECT transcript_kind, count(*) AS videos, round(sum(duration_s) / 3600) AS hours"
    " FROM youtube_videos GROUP BY ALL ORDER BY videos DESC",
    "wiki": "SELECT kind, region, count(*) AS elements FROM wiki_elements WHERE visible"
    " GROUP BY ALL ORDER BY elements DESC",
    "reddit": "SELECT type, count(*) AS posts, sum(comments_released) AS comments"
    " FROM reddit_posts GROUP BY ALL ORDER BY posts DESC",
    "pairs": "SELECT keyword, count(*) AS clips FROM pairs GROUP BY ALL ORDER BY clips DESC"
    " LIMIT 10",
    "links": "SELECT entity, source, sum(count) AS mentions FROM links GROUP BY ALL"
    " ORDER BY mentions DESC LIMIT 10",
}
_MAIN = {
    "youtube": "videos",
    "wiki": "pages",
    "reddit": "posts",
    "pairs": "pairs",
    "links": "links",
}
_PICTURED = {"pairs": "keyword", "links": "entity"}


class Bar(NamedTuple):
    """One line of the picture."""

    name: str
    n: int
    bar: str


def first(facts: Facts) -> dict[str, Any]:
    """What templates/first_screen.md.jinja says of a folder."""
    return {
        "query": _QUERIES[facts.source],
        "archive": next((one.name for one in facts.others if one.name.endswith(".tar")), None),
        "picture": picture(facts),
    }


def picture(facts: Facts) -> list[Bar]:
    """How much each stage left over, or how often the most frequent keywords are met."""
    if facts.source in STAGES:
        return _bars(_funnel(facts))
    keyword = _column(facts, _PICTURED[facts.source])
    return _bars(list(keyword.top) if keyword is not None else [])


def _funnel(facts: Facts) -> list[tuple[str, int]]:
    """What was read, then what was left behind each stage that dropped something."""
    dropped: dict[str, int] = {}
    for stage, _, n in facts.rejected:
        dropped[stage] = dropped.get(stage, 0) + n
    counted = {"reddit": ("posts", "comments")}.get(facts.source, (_MAIN[facts.source],))
    left = sum(one.rows for one in facts.tables if one.table.short in counted)
    left += sum(dropped.values())
    steps = [("read", left)]
    for stage in STAGES[facts.source]:
        if stage in dropped:
            left -= dropped[stage]
            steps.append((f"after {stage}", left))
    return steps


def _bars(steps: list[tuple[str, int]]) -> list[Bar]:
    most = max((n for _, n in steps), default=0)
    return [Bar(name, n, "█" * max(1, round(WIDTH * n / most))) for name, n in steps if n]


def _column(facts: Facts, name: str) -> ColumnFacts | None:
    main = next((one for one in facts.tables if one.table.short == _MAIN[facts.source]), None)
    columns = main.columns if main is not None else ()
    return next((one for one in columns if one.column.name == name), None)
