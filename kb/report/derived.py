"""Figures of pairs, tasks and links."""

from kb.core.config.profile import Profile
from kb.core.sources import SOURCES
from kb.look.charts import (
    GREEN,
    GREY,
    ORANGE,
    PALE,
    SKY,
    Figure,
    bars,
    canvas,
    even,
    histogram,
    number,
    powers,
    readable,
    rows_height,
    saved,
)
from kb.look.headings import reading
from kb.report.data import ReportData
from kb.report.figures import bar_figure

_LINKS, _ENTITIES = "links/links", "links/entities"
_NAMED = (
    "SELECT entity, {sources}, sum(count)::BIGINT AS n FROM {t} GROUP BY 1"
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
    tokens = even(low, max(high, low + 1) + 1, 25)
    clips = even(short, max(long, short + 1), 25)
    by_token = data.histogram("pairs/pairs", "token_count", tokens)
    by_clip = data.histogram("pairs/pairs", "clip_end_s - clip_start_s", clips)
    sheet, axes = canvas(2.7, 2, sharey=True)
    histogram(clips, by_clip, x="clip (seconds)", y="pairs", labels=4, color=GREEN, axes=axes[0])
    histogram(tokens, by_token, x="text (CLIP tokens)", y="", labels=4, color=ORANGE, axes=axes[1])
    axes[0].set_ylim(0, max(*by_clip, *by_token) * 1.06)
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


def named(data: ReportData, profile: Profile) -> Figure | None:
    """The entities that are named most and least, on one axis; how many are not at all."""
    most = max(3, profile.report.top_keywords // 3)
    sources = _sources(data)
    if not sources:
        return None
    sums = ", ".join(
        f"coalesce(sum(count) FILTER (source = '{source}'), 0)::BIGINT" for source in sources
    )
    first, last = (
        data.rows(_LINKS, _NAMED.replace("{sources}", sums).replace("{order}", order), most)
        for order in ("DESC", "ASC")
    )
    rows = [*first, *(row for row in reversed(last) if row not in first)]
    mentions, entities = data.rows(
        _LINKS, "SELECT sum(count)::BIGINT, count(DISTINCT entity) FROM {t}"
    )[0]
    between = entities - len(rows)
    places = [place + (place >= len(first) and between > 0) for place in range(len(rows))]
    labels = [readable(str(row[0])) for row in rows]
    counts = [row[-1] for row in rows]
    colors = [GREEN if place < len(first) else ORANGE for place in range(len(rows))]
    sheet, axes = canvas(rows_height(places[-1] + 1))
    axes.set_xscale("log")
    axes.set_xlim(min(counts) * 0.7, max(counts) * 3.2)
    axes.hlines(places, min(counts) * 0.7, counts, color=PALE, linewidth=1)
    axes.scatter(counts, places, color=colors, s=30, zorder=3)
    for place, count in zip(places, counts, strict=True):
        axes.annotate(
            number(count), (count, place), (6, 0), textcoords="offset points", va="center", size=9
        )
    if between > 0:
        places.insert(len(first), len(first))
        labels.insert(len(first), f"… {between:,} more …")
    axes.set_yticks(places, labels)
    axes.set_ylim(places[-1] + 0.6, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("mentions (logarithmic)")
    powers(axes.xaxis)
    listed = ", ".join(f"{row[0]} {row[-1]:,}" for row in (*first[:5], *rows[len(first) :][-5:]))
    return Figure(
        "links-named",
        "What is spoken of most and least",
        f"{mentions:,} mentions of {entities:,} entities, on a logarithmic axis: the {len(first)}"
        f" most frequent above, the {len(rows) - len(first)} least frequent below."
        f" {data.count(_ENTITIES) - entities:,} entities are named nowhere.",
        f"Dots of mentions by entity, most and least frequent: {listed}.",
        saved(sheet),
        ("entity", *sources, "mentions"),
        rows,
    )


def known(data: ReportData, profile: Profile) -> Figure | None:
    """How many entities only one source knows, and which; nothing where only one names any."""
    sources = _sources(data)
    if len(sources) < 2:
        return None
    by_source = {who: (n, names) for who, n, names in data.rows(_LINKS, _KNOWN)}
    nowhere = data.count(_ENTITIES) - sum(n for n, _ in by_source.values())
    every = _NUMBERS.get(len(sources), str(len(sources)))
    who = {source: SOURCES[source].only for source in sources}
    who |= {str(n): f"{_NUMBERS.get(n, n)} of the {every}" for n in range(2, len(sources))}
    who[str(len(sources))] = "both" if every == "two" else f"all {every}"
    rows = [(name, *by_source.get(entity, (0, ""))) for entity, name in who.items()]
    return bar_figure(
        "links-known",
        "Who knows what",
        f"Entities by the sources that name them: one source alone names"
        f" {sum(row[1] for row in rows[: len(sources)]):,}, none {nowhere:,}.",
        rows,
        head=("named by", "entities", "the most frequent of them"),
        described="entities by who names them",
        colors=SKY,
    )


def _sources(data: ReportData) -> list[str]:
    """The sources that name an entity."""
    naming = {source for (source,) in data.rows(_LINKS, "SELECT DISTINCT source FROM {t}")}
    return [source for source in SOURCES if source in naming]


def titles(data: ReportData, profile: Profile) -> Figure | None:
    """What becomes of the titles: tasks by where their times come from, and reasons for none."""
    rows, colors = [], []
    for table, column, text, color in (
        ("tasks/tasks", "start_source", "task (start: {})", GREEN),
        ("tasks/titles", "rejected_reason", "{}", GREY),
    ):
        counted = data.rows(table, f"SELECT {column}, count(*) FROM {{t}} GROUP BY 1")
        for value, n in sorted(counted, key=lambda row: (-row[1], row[0])):
            rows.append((text.format(reading(table, column, value)), n))
            colors.append(color)
    if not rows:
        return None
    tasks, total = data.count("tasks/tasks"), sum(n for _, n in rows)
    return bar_figure(
        "tasks-titles",
        "Which titles give a task",
        f"{tasks:,} of {total:,} titles give a task, by what says when it begins; below them the"
        " others, by the reason.",
        rows,
        head=("title", "titles"),
        colors=colors,
    )
