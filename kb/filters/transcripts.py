"""Stage `transcript`: what becomes of a video without English transcript."""

from __future__ import annotations

from kb.filters.judgement import Predicate
from kb.filters.predicates import NotIn, Waits

NONE = ("none", "disabled", "unavailable", "age_restricted")


def required() -> tuple[Predicate, ...]:
    """Without one it is dropped; not asked for yet, or not to be had without a PO token, it waits;
    not had after all tries it failed.
    """
    return (
        Waits(
            "transcript_outcome",
            ("failed",),
            stage="transcript",
            reason="transcript",
            verdict="failed",
        ),
        Waits("transcript_outcome", ("po_token",), stage="transcript", reason="po_token"),
        Waits("transcript_kind", ("unknown",), stage="transcript", reason="transcript"),
        NotIn("transcript_outcome", NONE, stage="transcript"),
    )
