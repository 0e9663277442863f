"""The figures of each source and of the pairs, in the order of the page."""

import itertools
from functools import partial

from kb.core.config.profile import Profile
from kb.report.charts import bars, even, histogram
from kb.report.data import ReportData
from kb.report.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    Figure,
    canvas,
    number,
    readable,
    saved,
)
from kb.report.figures import bar_figure, dates, funnel, logarithmic, toxicity, values
from kb.report.wiki_page import KINDS, page
from kb.report.word_cloud import words

_VIDEOS = "youtube/videos"
_CHANNELS = 10


def durations(data: ReportData, profile: Profile) -> Figure | None:
    """Video durations, trimmed at a percentile (the paper's figure)."""
    percent = profile.report.trim_percentile
    high = data.quantile(_VIDEOS, "duration_s", percent / 100)
    middle = data.quantile(_VIDEOS, "duration_s", 0.5)
    if high is None or middle is None:
        return None
    low = float(profile.youtube.min_duration_s) if profile.youtube else 0.0
    edges = even(min(low, high), max(high, low + 60))
    counts = data.histogram(_VIDEOS, "duration_s", edges)
    minutes = [edge / 60 for edge in edges]
    sheet = histogram(
        minutes,
        counts,
        x="duration (minutes)",
        y="videos",
        marks=[(middle / 60, f"median {middle / 60:.1f} min")],
    )
    return Figure(
        "youtube-durations",
        "How long the videos are",
        (
            f"Durations up to the {percent:g}th percentile ({high / 60:.1f} minutes); "
            f"the longest {100 - percent:g}% are left out, as in the paper."
        ),
        (
            f"Histogram of video durations from {minutes[0]:.0f} to {minutes[-1]:.1f} minutes; "
            f"half of the videos are shorter than {middle / 60:.1f} minutes."
        ),
        saved(sheet),
        ("minutes", "videos"),
        [
            (f"{a:.1f} to {b:.1f}", n)
            for (a, b), n in zip(itertools.pairwise(minutes), counts, strict=True)
        ],
    )


def channels(data: ReportData, profile: Profile) -> Figure | None:
    """How many of the videos the largest channels have."""
    share = data.channels(_CHANNELS)
    if share is None:
        return None
    shown = sum(n for _, n in share.largest) / share.videos
    return bar_figure(
        "youtube-channels",
        "Whose videos they are",
        f"{share.videos:,} videos of {share.channels:,} channels. The {len(share.largest)} shown "
        f"have {shown:.0%} of the videos; half of all come from {share.half:,}.",
        share.largest,
        head=("channel", "videos"),
        labels=[readable(name) for name, _ in share.largest],
        notes=[f"{number(n)}  ({n / share.videos:.1%})" for _, n in share.largest],
    )


YOUTUBE = (
    partial(funnel, name=_VIDEOS),
    durations,
    partial(
        logarithmic,
        table=_VIDEOS,
        column="view_count",
        name="youtube-views",
        title="How often they were watched",
        x="views of a video (logarithmic)",
        unit="views",
        color=BLUE,
    ),
    partial(dates, table=_VIDEOS, column="published_at", what="published", color=BLUE),
    channels,
    partial(
        values,
        table=_VIDEOS,
        column="transcript_kind",
        name="youtube-transcripts",
        title="Where the transcripts come from",
        caption="{total} kept videos by the kind of their transcript.",
        head=("transcript", "videos"),
        styles={
            "manual": ("by people", BLUE),
            "asr": ("automatic", ORANGE),
            "translated": ("translated", GREEN),
            "none": ("none", GREY),
            "unknown": ("not known yet", SKY),
        },
    ),
    partial(toxicity, table=_VIDEOS, columns=("toxicity_title", "toxicity_description")),
    partial(words, table=_VIDEOS, columns=("title",)),
)


_PAGES = "wiki/pages"
WIKI = (
    page,
    partial(funnel, name=_PAGES),
    partial(
        values,
        table="wiki/elements",
        column="kind",
        name="wiki-elements",
        title="What is on the pages",
        caption="{total} elements with a box, by kind.",
        head=("kind", "elements"),
        styles={kind: (kind, look.color) for kind, look in KINDS.items()},
        shares=False,
    ),
    partial(dates, table=_PAGES, column="revision_timestamp", what="revised", color=GREEN),
    partial(toxicity, table=_PAGES, columns=("toxicity",)),
)


_POSTS, _COMMENTS = "reddit/posts", "reddit/comments"
_TYPES = {
    "text": BLUE,
    "image": ORANGE,
    "video": GREEN,
    "link": PURPLE,
    "poll": SKY,
    "gallery": RED,
}
REDDIT = (
    partial(funnel, name=_POSTS),
    partial(
        values,
        table=_POSTS,
        column="type",
        name="reddit-types",
        title="What kinds of posts there are",  # the paper's figure
        caption="{total} kept posts by type; a crosspost has its parent's type.",
        head=("type", "posts"),
        styles={name: (name, color) for name, color in _TYPES.items()},
    ),
    partial(
        logarithmic,
        table=_POSTS,
        column="score",
        name="reddit-scores",
        title="How posts were voted",
        x="score of a post (logarithmic)",
        unit="points",
        color=PURPLE,
    ),
    partial(dates, table=_POSTS, column="created_utc", what="made", color=PURPLE),
    partial(funnel, name=_COMMENTS),
    partial(toxicity, table=_POSTS, columns=("toxicity_title", "toxicity_body")),
    partial(toxicity, table=_COMMENTS, columns=("toxicity_body",)),
    partial(words, table=_POSTS, columns=("title", "body")),
)


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


PAIRS = (keywords, lengths, quality)


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


TASKS = (titles,)
