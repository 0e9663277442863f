"""Release (MineDojo paper, appendix "Datasheet": distribution and maintenance).

A folder for each source and for the pairs, checked, described and licensed, and one deposit per
folder or one repository of all: what the paper's authors made by hand.

    gate       secrets, content, scores, descriptions, counts, licences, checksums, personal data,
               age
    describe   card, datasheet, Croissant, citation, deposit metadata, licence, tombstones, sample,
               checksums
    publish    one draft deposit per folder, published only on request; or one revision of a
               repository of the Hugging Face hub
"""

from collections.abc import Sequence
from typing import Any

from kb.core.context import Run
from kb.core.summary import Summary
from kb.release import build
from kb.release.publish.publish import plan as plan_upload
from kb.release.publish.publish import publish as upload


def release(run: Run, only: Sequence[str] = ()) -> Summary:
    """Run the gate, then write everything that describes the data."""
    return build.release(run, only)


def publish(run: Run, to: str, only: list[str], **how: Any) -> Summary:
    """Run the gate again, then upload every folder."""
    return upload(run, to, only=only, **how)


def plan(run: Run, to: str, only: list[str], named: str | None) -> Summary:
    """What an upload would send."""
    return plan_upload(run, to, only=only, named=named)
