"""Release (MineDojo paper, appendix "Datasheet": distribution and maintenance).

A folder for each source and for the pairs, checked, described and licensed, and one deposit per
folder or one repository of all: what the paper's authors made by hand.

    gate       secrets, content, scores, descriptions, counts, licences, checksums, personal data,
               age
    describe   card, datasheet, Croissant, citation, deposit metadata, licence, tombstones, sample,
               checksums
"""

from collections.abc import Sequence

from kb.artifacts import freshness
from kb.core.context import Run
from kb.core.summary import Summary
from kb.labels.imports import measure_labels
from kb.registry import PUBLISHED
from kb.release import build


def release_needs(run: Run) -> None:
    """Raises NotReleasable without licence, creator or contact."""
    names = [name.removeprefix("release/") for name in freshness.graph(run)]
    build.refuse_unsigned(run.profile, names)


def release(run: Run, only: Sequence[str] = ()) -> Summary:
    """Run the gate, then write everything that describes the data, with today's judgements."""
    measure_labels(run)
    return build.release(run, PUBLISHED, only)
