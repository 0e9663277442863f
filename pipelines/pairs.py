"""Video-text pairs (MineDojo paper, data collection appendix, "video-text pairs"; 640K pairs
there).

A list of keywords is matched in the transcripts of the kept videos. Each match is extended at
random to 16–77 CLIP tokens; a random moment within the match's cues is the centre of a clip of
8–16 s. The profile decides what the paper leaves open: whole words, rules for everyday words, and
which of a video's overlapping clips are kept.

    build      transcripts → pairs/pairs-*.parquet
    release    pairs/ → release/pairs/, without text
    layouts    pairs/ → export/<format>/
    refill     a released index and one's own transcripts → pairs/pairs-*.parquet
"""

from pathlib import Path

from kb.artifacts import domain_binding
from kb.core.context import Run
from kb.core.errors import LimitReached
from kb.core.summary import Summary
from kb.export import layouts
from kb.pairs.build import build, check
from kb.store.layout import Layout


def pairs(run: Run, layout: str) -> Summary:
    """Make the pairs, then write them in the given layout."""
    check(run)
    with domain_binding.writing(run, "pairs", "release-pairs"):
        try:
            made = build(run)
        except LimitReached:
            _write(run, layout)  # what is done so far is complete in itself
            raise
        return Summary(made, **_write(run, layout))


def refill(run: Run, index: Path) -> Summary:
    """Fill in the texts of a released index from your own transcripts."""
    from kb.pairs.restore import refill

    return refill(run, index)


def _write(run: Run, layout: str) -> dict[str, object]:
    """Write the release or another layout; returns where."""
    made = layouts.export(run, "pairs", layout)
    return {"release": str(Layout(run.root).release("pairs"))} if layout == "parquet" else made
