"""Figures of videos, in the order of the report."""

import itertools
from functools import partial

from kb.core.config.profile import Profile
from kb.look.charts import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
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
