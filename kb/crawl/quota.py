"""What a service gives a day, kept in the ledger of a crawl's state and never overrun knowingly."""

from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from zoneinfo import ZoneInfo

from kb.core import clock
from kb.core.errors import QuotaSpent
from kb.store.state.frontier import Frontier


@dataclass(frozen=True)
class Quota:
    """Units of one bucket of the ledger in a service's day, which begins at its own midnight.

    called     for messages: "the search quota of the YouTube API"
    per_day    0 for as many as one likes
    time_zone  whose midnight
    """

    bucket: str
    called: str = ""
    per_day: int = 0
    time_zone: str = "UTC"

    def today(self) -> str:
        """The service's day now, "2026-11-20"."""
        return f"{clock.now().astimezone(ZoneInfo(self.time_zone)):%Y-%m-%d}"

    def reset(self) -> datetime:
        """When it ends, as UTC."""
        zone = ZoneInfo(self.time_zone)
        tomorrow = clock.now().astimezone(zone).date() + timedelta(days=1)
        return datetime.combine(tomorrow, time(), zone).astimezone(UTC)

    def used(self, frontier: Frontier) -> int:
        """Units that are spent today."""
        return frontier.spent(self.bucket, self.today())

    def spend(self, frontier: Frontier, endpoint: str, units: int) -> int:
        """Write the ledger's row of a request that is about to be sent; its id. Raises QuotaSpent
        for one that is too many, with nothing written.
        """
        if self.per_day and self.used(frontier) + units > self.per_day:
            raise self.spent()
        return frontier.spend(self.bucket, units, endpoint, day=self.today())

    def spent(self) -> QuotaSpent:
        """The error for a quota that is used up for today."""
        reset = self.reset()
        return QuotaSpent(
            f"{self.called} is spent; it is reset at {clock.stamp(reset)}",
            hint="run the same command then, or add --wait",
            until=reset,
        )
