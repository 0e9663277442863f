"""The video-text pairs: their keywords, their lengths."""

from kb.core.config.profile import Profile
from kb.report.charts import even, histogram
from kb.report.data import ReportData
from kb.report.figure_style import GREEN, ORANGE, Figure, canvas, readable, saved
from kb.report.figures import bar_figure


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


FIGURES = (keywords, lengths)
