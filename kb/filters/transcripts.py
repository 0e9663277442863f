"""Stage `transcript`: what becomes of a video without English transcript."""

from __future__ import annotations

from kb.filters.judgement import Predicate
from kb.filters.predicates import NotIn, Waits

NONE = ("none", "disabled", "unavailable", "age_restricted")


def required() -> tuple[Predicate, ...]:
    """Without one it is dropped; not asked for yet it waits; not had after all tries it failed."""
    return (
        Waits(
            "transcript_outcome",
            ("failed",),
            stage="transcript",
            reason="transcript",
            verdict="failed",
        ),
        Waits("transcript_kind", ("unknown",), stage="transcript", reason="transcript"),
        NotIn("transcript_outcome", NONE, stage="transcript"),
    )
