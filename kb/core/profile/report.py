"""[report] of a profile: how much the figures show."""

from __future__ import annotations

from pydantic import Field

from kb.core.profile.base import Section


class Report(Section):
    """The report part of a profile (figures of the MineDojo paper's data appendix)."""

    table = "report"
    about = "Report: how much the figures show"

    trim_percentile: float = Field(
        85,
        gt=0,
        le=100,
        description="durations above this percentile are left out of their histogram,"
        " as in the paper",
    )
    cloud_words: int = Field(150, ge=10, le=1000, description="words in the word cloud")
    stop_words: tuple[str, ...] = Field(
        (), description="words excluded from the word cloud, besides the usual ones"
    )
    top_keywords: int = Field(25, ge=1, le=100, description="keywords shown in the pairs figure")
    samples: int = Field(8, ge=0, le=100, description="rows of each table shown on the page")
