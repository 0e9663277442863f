"""What `kb status` says about YouTube: quota units, the buckets of the day, captions kept back."""

from typing import Any

from kb.core import clock
from kb.core.config.profile.collecting import YouTubeSection
from kb.core.context import Run
from kb.store.state.frontier import Frontier
from kb.youtube.crawl import quota
from kb.youtube.crawl.reduce import with_po_token


def status(run: Run, frontier: Frontier) -> dict[str, Any]:
    """Units spent in all, what is left of today's buckets, and videos that need a PO token."""
    _, units = frontier.requests()
    section = run.profile.youtube
    return {
        "units": units,
        "quota": {} if section is None else _buckets(section, frontier),
        "po_token": with_po_token(frontier),
    }


def _buckets(section: YouTubeSection, frontier: Frontier) -> dict[str, Any]:
    day, reset_at = quota.today(), clock.stamp(quota.next_reset())
    limits = {bucket: quota.limit(section, bucket) for bucket in quota.BUCKETS}
    spent = {bucket: frontier.spent(bucket, day) for bucket in limits}
    return {
        bucket: {
            "spent": spent[bucket],
            "left": max(0, limit - spent[bucket]),
            "limit": limit,
            "resets_at": reset_at,
        }
        for bucket, limit in limits.items()
    }
