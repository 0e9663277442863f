"""Figures of pairs, tasks and links."""

from kb.core.config.profile import Profile
from kb.core.sources import SOURCES
from kb.look.charts import (
    GREEN,
    ORANGE,
    SKY,
    Figure,
    bars,
    canvas,
    even,
    histogram,
    number,
    readable,
    saved,
)
from kb.report.data import ReportData
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


def keywords(data: ReportData, profile: Profile) -> Figure | None:
    """Pairs for each of the most frequent keywords."""
    top = data.top("pairs/pairs", "keyword", profile.report.top_keywords)
    if not top:
        return None
    total = data.count("pairs/pairs")
    distinct = data.rows("pairs/pairs", "SELECT count(DISTINCT keyword) FROM {t}")[0][0]
    return bar_figure(
        "pairs-keywords",
        "Which keywords are spoken",
        f"{total:,} pairs of {distinct:,} keywords; the {len(top)} most frequent.",
        top,
        head=("keyword", "pairs"),
        labels=[readable(name) for name, _ in top],
        named=10,
        colors=GREEN,
    )


def lengths(data: ReportData, profile: Profile) -> Figure | None:
    """Lengths of clips and texts of the pairs."""
    rows = data.rows(
        "pairs/pairs",
        (
            "SELECT min(token_count), max(token_count), min(clip_end_s - clip_start_s),"
            " max(clip_end_s - clip_start_s) FROM {t}"
        ),
    )
    if not rows or rows[0][0] is None:
        return None
    low, high, short, long = (float(value) for value in rows[0])
    tokens = even(low, max(high, low + 1) + 1, 20)
    clips = even(short, max(long, short + 1), 20)
    by_token = data.histogram("pairs/pairs", "token_count", tokens)
    by_clip = data.histogram("pairs/pairs", "clip_end_s - clip_start_s", clips)
    sheet, axes = canvas(2.7, 2)
    histogram(clips, by_clip, x="clip (seconds)", y="pairs", color=GREEN, axes=axes[0])
    histogram(tokens, by_token, x="text (CLIP tokens)", y="", color=ORANGE, axes=axes[1])
    return Figure(
        "pairs-lengths",
        "How long clips and texts are",
        f"Clips last {short:.1f} to {long:.1f} seconds, "
        f"texts have {low:.0f} to {high:.0f} CLIP tokens.",
        (
            f"Two histograms: clip length from {short:.1f} to {long:.1f} seconds, "
            f"text length from {low:.0f} to {high:.0f} tokens."
        ),
        saved(sheet),
        ("seconds", "pairs"),
        [(f"{a:.1f} to {b:.1f}", n) for a, b, n in zip(clips, clips[1:], by_clip, strict=False)],
    )


_QUALITY = "pairs/quality"

# What is counted of the pairs, as SQL over pairs/quality; {main} is their most frequent language.
_COUNTED = {
    "time of the word known": "interpolation_error_s IS NOT NULL",
    "near-duplicate": "duplicate_of IS NOT NULL",
    "mostly recurring text": "recurring_share > 0.5",
    "other language": "language IS DISTINCT FROM {main}",
    "verb near the keyword": "has_verb",
}


def quality(data: ReportData, profile: Profile) -> Figure | None:
    """How far off times by cues are, and what else is counted of the pairs."""
    main = data.top(_QUALITY, "language", 1)
    if not main:
        return None
    tests = [test.format(main=f"'{main[0][0]}'") for test in _COUNTED.values()]
    counts = ", ".join(f"count(*) FILTER ({test})" for test in tests)
    ends = ", ".join(f"quantile_cont(interpolation_error_s, {q})" for q in (0.01, 0.25, 0.75, 0.99))
    ((total, *rest),) = data.rows(_QUALITY, f"SELECT count(*), {counts}, {ends} FROM {{t}}")
    numbers, (low, early, late, high) = rest[: len(tests)], rest[len(tests) :]
    rows = list(zip(_COUNTED, numbers, strict=True))
    notes = [f"{number(n)}  ({n / total:.0%})" for n in numbers]
    caption, sheet = f"Of {total:,} pairs, by pairs/quality.", None
    if low is not None:
        sheet, axes = canvas(5, 1, 2)
        edges = even(low, max(high, low + 0.1))
        errors = data.histogram(_QUALITY, "interpolation_error_s", edges)
        x = "cue time minus word time (seconds)"
        histogram(edges, errors, x=x, y="pairs", color=SKY, axes=axes[0])
        bars(list(_COUNTED), numbers, unit="pairs", notes=notes, colors=GREEN, axes=axes[1])
        caption += (
            " Above: how much later a match would begin if only the time of its cue were known;"
            f" half of them between {early:.2f} and {late:.2f} seconds."
        )
    else:
        sheet = bars(list(_COUNTED), numbers, unit="pairs", notes=notes, colors=GREEN)
    listed = ", ".join(f"{name} {n:,}" for name, n in rows)
    alt = f"Bars of what is counted of {total:,} pairs: {listed}."
    title = "What is known of their quality"
    return Figure("pairs-quality", title, caption, alt, saved(sheet), ("figure", "pairs"), rows)


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


def titles(data: ReportData, profile: Profile) -> Figure | None:
    """What becomes of the titles: tasks by where their times come from, and reasons for none."""
    times = data.rows(
        "tasks/tasks", "SELECT 'task: ' || start_source, count(*) FROM {t} GROUP BY 1"
    )
    none = data.rows("tasks/titles", "SELECT rejected_reason, count(*) FROM {t} GROUP BY 1")
    rows = [*sorted(times), *sorted(none, key=lambda row: (-row[1], row[0]))]
    if not rows:
        return None
    tasks, total = sum(n for _, n in times), sum(n for _, n in rows)
    return bar_figure(
        "tasks-titles",
        "Which titles give a task",
        f"{tasks:,} tasks of {total:,} titles, by what says when they begin; the others by reason.",
        rows,
        head=("title", "titles"),
        labels=[readable(name) for name, _ in rows],
        colors=GREEN,
    )
