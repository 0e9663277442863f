"""What is spoken of: by how many mentions, and which things only one source knows."""

from kb.core.config.profile import Profile
from kb.core.sources import SOURCES
from kb.report.data import ReportData
from kb.report.figure_style import GREEN, ORANGE, SKY, Figure, readable
from kb.report.figures import bar_figure

_LINKS, _ENTITIES = "links/links", "links/entities"
_HEAD = ("entity", *SOURCES, "mentions")
_BY_SOURCE = ", ".join(
    f"coalesce(sum(count) FILTER (source = '{source}'), 0)::BIGINT AS {source}"
    for source in SOURCES
)
_NAMED = (
    f"SELECT entity, {_BY_SOURCE}, sum(count)::BIGINT AS n FROM {{t}} GROUP BY 1"
    " ORDER BY n {order}, entity LIMIT ?"
)
_KNOWN = """
    WITH e AS (
        SELECT entity, sum(count) AS n, count(DISTINCT source) AS sources, min(source) AS one
        FROM {t} GROUP BY 1
    )
    SELECT CASE sources WHEN 1 THEN one ELSE sources::VARCHAR END AS who, count(*),
        array_to_string(list(entity ORDER BY n DESC, entity)[:8], ', ')
    FROM e GROUP BY 1"""
_NUMBERS = {2: "two", 3: "three", 4: "four", 5: "five"}
_ALL = _NUMBERS.get(len(SOURCES), str(len(SOURCES)))
_WHO = {
    **{name: source.only for name, source in SOURCES.items()},
    **{str(n): f"{_NUMBERS.get(n, n)} of the {_ALL}" for n in range(2, len(SOURCES))},
    str(len(SOURCES)): f"all {_ALL}",
}


def most(data: ReportData, profile: Profile) -> Figure | None:
    """The entities that are named most."""
    rows = data.rows(_LINKS, _NAMED.replace("{order}", "DESC"), profile.report.top_keywords)
    if not rows:
        return None
    total = data.rows(_LINKS, "SELECT sum(count)::BIGINT, count(DISTINCT entity) FROM {t}")[0]
    return _named(
        "links-most",
        "What is spoken of most",
        f"{total[0]:,} mentions of {total[1]:,} entities in titles, texts, transcripts, pages and"
        f" comments; the {len(rows)} most frequent.",
        rows,
        GREEN,
    )


def least(data: ReportData, profile: Profile) -> Figure | None:
    """The entities that are named, and least; how many are not at all."""
    rows = data.rows(_LINKS, _NAMED.replace("{order}", "ASC"), profile.report.top_keywords)
    if not rows:
        return None
    named = data.rows(_LINKS, "SELECT count(DISTINCT entity) FROM {t}")[0][0]
    return _named(
        "links-least",
        "What is spoken of least",
        f"Named nowhere: {data.count(_ENTITIES) - named:,} entities; of those that are named, the"
        f" {len(rows)} least frequent.",
        rows,
        ORANGE,
    )


def known(data: ReportData, profile: Profile) -> Figure | None:
    """How many entities only one source knows, and which."""
    by_source = {who: (n, names) for who, n, names in data.rows(_LINKS, _KNOWN)}
    if not by_source:
        return None
    nowhere = data.count(_ENTITIES) - sum(n for n, _ in by_source.values())
    rows = [(name, *by_source.get(who, (0, ""))) for who, name in _WHO.items()]
    return bar_figure(
        "links-known",
        "Who knows what",
        f"Entities by the sources that name them: one source alone names"
        f" {sum(row[1] for row in rows[: len(SOURCES)]):,}, none {nowhere:,}.",
        rows,
        head=("named by", "entities", "the most frequent of them"),
        described="entities by who names them",
        colors=SKY,
    )


def _named(
    name: str, title: str, caption: str, rows: list[tuple[object, ...]], color: str
) -> Figure:
    labels = [readable(str(row[0])) for row in rows]
    return bar_figure(
        name, title, caption, rows, head=_HEAD, labels=labels, named=10, at=-1, colors=color
    )
