"""Figures of videos, in the order of the report."""

import itertools
from dataclasses import dataclass
from functools import partial

from kb.core.config.profile import Profile
from kb.look.charts import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SIXTIETHS,
    SKY,
    Figure,
    even,
    histogram,
    number,
    readable,
    saved,
)
from kb.report.data import ReportData
from kb.report.figures import bar_figure, dates, funnel, logarithmic, toxicity, values
from kb.report.word_cloud import words
from kb.youtube.section import YouTubeSection

_VIDEOS = "youtube/videos"
_CHANNELS = 10


@dataclass(frozen=True)
class Channels:
    """Whose the videos are: (title, videos) of the largest channels; `half`: how many have half."""

    videos: int
    channels: int
    half: int
    largest: list[tuple[str, int]]


def largest_channels(data: ReportData, n: int) -> Channels | None:
    """The `n` channels with most videos, and how many there are; None when none is named."""
    sums = data.rows(
        "youtube/videos",
        "WITH c AS (SELECT count(*) AS n FROM {t} WHERE channel_id IS NOT NULL"
        " GROUP BY channel_id), s AS (SELECT n, sum(n) OVER () AS whole, sum(n) OVER"
        " (ORDER BY n DESC ROWS UNBOUNDED PRECEDING) - n AS before FROM c)"
        " SELECT sum(n), count(*), count(*) FILTER (before * 2 < whole) FROM s",
    )
    if not sums or not sums[0][0]:
        return None
    largest = data.rows(
        "youtube/videos",
        "SELECT coalesce(min(channel_title), channel_id), count(*) AS n FROM {t}"
        " WHERE channel_id IS NOT NULL GROUP BY channel_id"
        f" ORDER BY n DESC, channel_id LIMIT {n}",
    )
    return Channels(int(sums[0][0]), sums[0][1], sums[0][2], largest)


def durations(data: ReportData, profile: Profile) -> Figure | None:
    """Video durations, trimmed at a percentile (the paper's figure)."""
    percent = profile.report.trim_percentile
    high = data.quantile(_VIDEOS, "duration_s", percent / 100)
    middle = data.quantile(_VIDEOS, "duration_s", 0.5)
    if high is None or middle is None:
        return None
    section = profile.section_if_any(YouTubeSection)
    low = float(section.min_duration_s) if section else 0.0
    unit, seconds = "minutes", 60
    if high < 120:
        unit, seconds = "seconds", 1
    elif high > 4 * 3600:
        unit, seconds = "hours", 3600
    steps = () if unit == "hours" else SIXTIETHS
    edges = even(min(low, high) / seconds, max(high, low + 60) / seconds, 40, (0.5, *steps))
    shown = f"CASE WHEN duration_s <= {high!r} THEN duration_s / {seconds}.0 END"
    counts = data.histogram(_VIDEOS, shown, edges)
    sheet = histogram(
        edges,
        counts,
        x=f"duration ({unit})",
        y="videos",
        steps=steps,
        marks=[(middle / seconds, f"median {number(round(middle / seconds, 1))} {unit}")],
    )
    return Figure(
        "youtube-durations",
        "How long the videos are",
        (
            f"Durations up to the {percent:g}th percentile ({high / 60:.1f} minutes); "
            f"the longest {100 - percent:g}% are left out, as in the paper."
        ),
        (
            f"Histogram of video durations from {number(edges[0])} to {number(edges[-1])} {unit}; "
            f"half of the videos are shorter than {middle / seconds:.1f} {unit}."
        ),
        saved(sheet),
        (unit, "videos"),
        [
            (f"{number(a)} to {number(b)}", n)
            for (a, b), n in zip(itertools.pairwise(edges), counts, strict=True)
        ],
    )


def channels(data: ReportData, profile: Profile) -> Figure | None:
    """How many of the videos the largest channels have."""
    share = largest_channels(data, _CHANNELS)
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


FIGURES = (
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
        colors={"manual": BLUE, "asr": ORANGE, "translated": GREEN, "none": GREY, "unknown": SKY},
    ),
    partial(toxicity, table=_VIDEOS, columns=("toxicity_title", "toxicity_description")),
    partial(words, name="youtube-words", tables={_VIDEOS: ("title",)}),
)
