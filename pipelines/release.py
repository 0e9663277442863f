"""Release (MineDojo paper, appendix "Datasheet": distribution and maintenance).

What the paper published by hand for each of its three sources, made from the data: a folder for
each source and for the pairs, checked, described and licensed, and one deposit a folder.

    gate       secrets, content, scores, descriptions, counts, licences, checksums, personal data,
               age
    describe   card, datasheet, Croissant, citation, deposit metadata, licence, tombstones, sample,
               checksums
    publish    one draft deposit a folder; published only when asked to
"""

from __future__ import annotations

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.release.publish.publish import publish as upload


def release(run: Run, only: list[str]) -> Summary:
    """Gate, then everything around the data."""
    from kb.release.build import release

    return release(run, only)


def publish(run: Run, to: str, publish: bool, only: list[str]) -> Summary:
    """The gate again, then one deposit for each folder."""
    return upload(run, to, publish=publish, only=only)
