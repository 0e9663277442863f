"""The Data API's quota: buckets of a Pacific day, kept in the ledger and never overrun knowingly.

search     search.list, 1 a call
general    every other list call, 1 a call
statistics videos.batchGetStats, 1 a call
web        requests to the public site: no units, counted only
"""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

from kb.core import clock
from kb.core.errors import QuotaSpent
from kb.store.state.frontier import Frontier
from kb.youtube.section import YouTubeSection

PACIFIC = ZoneInfo("America/Los_Angeles")
SEARCH, GENERAL, STATISTICS, WEB = "search", "general", "statistics", "web"
BUCKETS = (GENERAL, SEARCH, STATISTICS)
STATISTICS_PER_DAY = 10_000  # YouTube's own; no project asks for more


def today() -> str:
    """The quota's day now, "2026-11-20"."""
    return f"{clock.now().astimezone(PACIFIC):%Y-%m-%d}"


def next_reset() -> datetime:
    """When the day ends: midnight in California, as UTC."""
    local = clock.now().astimezone(PACIFIC)
    midnight = datetime.combine(local.date() + timedelta(days=1), datetime.min.time(), PACIFIC)
    return midnight.astimezone(UTC)


def limit(profile: YouTubeSection, bucket: str) -> int:
    """Units a day of a bucket."""
    if bucket == STATISTICS:
        return STATISTICS_PER_DAY
    return profile.searches_per_day if bucket == SEARCH else profile.units_per_day


def spend(frontier: Frontier, profile: YouTubeSection, bucket: str, endpoint: str) -> int:
    """Write the ledger row of a call of one unit, before it is made; its id. Raises QuotaSpent,
    with nothing written.
    """
    day = today()
    if frontier.spent(bucket, day) >= limit(profile, bucket):
        raise spent(bucket)
    return frontier.spend(bucket, 1, endpoint, day=day)


def spent(bucket: str) -> QuotaSpent:
    """The error for a bucket that is used up for today."""
    reset = next_reset()
    return QuotaSpent(
        f"the {bucket} quota of the YouTube API is spent; it is reset at {clock.stamp(reset)}",
        hint="run the same command then, or add --wait",
        until=reset,
    )
