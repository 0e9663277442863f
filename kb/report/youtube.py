"""The videos: how long they are, what transcripts they have, whose they are."""

from __future__ import annotations

from functools import partial

from kb.core.profile import Profile
from kb.report import cloud
from kb.report.charts import bars, even, histogram
from kb.report.data import ReportData
from kb.report.dates import dates
from kb.report.funnel import funnel
from kb.report.logarithmic import views
from kb.report.style import BLUE, GREEN, GREY, ORANGE, SKY, Figure, number, readable, saved
from kb.report.toxicity import toxicity

_CHANNELS = 10
_KINDS = {
    "manual": ("by people", BLUE),
    "asr": ("automatic", ORANGE),
    "translated": ("translated", GREEN),
    "none": ("none", GREY),
    "unknown": ("not known yet", SKY),
}


def durations(data: ReportData, profile: Profile) -> Figure | None:
    """Video durations, trimmed at a percentile (the paper's figure)."""
    percent = profile.report.trim_percentile
    high = data.quantile("youtube/videos", "duration_s", percent / 100)
    middle = data.quantile("youtube/videos", "duration_s", 0.5)
    if high is None or middle is None:
        return None
    low = float(profile.youtube.min_duration_s) if profile.youtube else 0.0
    edges = even(min(low, high), max(high, low + 60))
    values = data.histogram("youtube/videos", "duration_s", edges)
    minutes = [edge / 60 for edge in edges]
    sheet = histogram(
        minutes,
        values,
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
        [(f"{a:.1f} to {b:.1f}", n) for a, b, n in zip(minutes, minutes[1:], values, strict=False)],
    )


def transcripts(data: ReportData, profile: Profile) -> Figure | None:
    """Where the videos' transcripts come from."""
    top = data.top("youtube/videos", "transcript_kind", 8)
    total = sum(n for _, n in top)
    if not total:
        return None
    sheet = bars(
        [_KINDS.get(kind, (kind, GREY))[0] for kind, _ in top],
        [n for _, n in top],
        unit="videos",
        notes=[f"{number(n)}  ({n / total:.0%})" for _, n in top],
        colors=[_KINDS.get(kind, (kind, GREY))[1] for kind, _ in top],
    )
    return Figure(
        "youtube-transcripts",
        "Where the transcripts come from",
        f"{total:,} kept videos by the kind of their transcript.",
        "Bars of videos by transcript: " + ", ".join(f"{kind} {n:,}" for kind, n in top) + ".",
        saved(sheet),
        ("transcript", "videos"),
        top,
    )


def channels(data: ReportData, profile: Profile) -> Figure | None:
    """How much of the videos the largest channels have."""
    share = data.channels(_CHANNELS)
    if share is None:
        return None
    sheet = bars(
        [readable(name) for name, _ in share.largest],
        [n for _, n in share.largest],
        unit="videos",
        notes=[f"{number(n)}  ({n / share.videos:.1%})" for _, n in share.largest],
    )
    shown = sum(n for _, n in share.largest) / share.videos
    return Figure(
        "youtube-channels",
        "Whose videos they are",
        f"{share.videos:,} videos of {share.channels:,} channels. The {len(share.largest)} shown "
        f"have {shown:.0%} of the videos; half of all come from {share.half:,}.",
        "Bars of videos by channel: "
        + ", ".join(f"{name} {n:,}" for name, n in share.largest)
        + ".",
        saved(sheet),
        ("channel", "videos"),
        share.largest,
    )


_VIDEOS = "youtube/videos"
FIGURES = (
    partial(funnel, name=_VIDEOS),
    durations,
    views,
    partial(dates, table=_VIDEOS, column="published_at", what="published", color=BLUE),
    channels,
    transcripts,
    partial(toxicity, table=_VIDEOS, columns=("toxicity_title", "toxicity_description")),
    partial(cloud.words, table=_VIDEOS, columns=("title",)),
)
