"""The buckets of YouTube's quota.

search     search.list, 1 a call
general    every other list call, 1 a call
statistics videos.batchGetStats, 1 a call
web        requests to the public site: no units, counted only
"""

from kb.crawl.quota import Quota
from kb.youtube.section import YouTubeSection

API, WEB = "api", "web"  # services
SEARCH, GENERAL, STATISTICS = "search", "general", "statistics"
BUCKETS = (GENERAL, SEARCH, STATISTICS)
STATISTICS_PER_DAY = 10_000  # YouTube's own; no project asks for more
SITE = Quota(WEB)


def quota(profile: YouTubeSection, bucket: str) -> Quota:
    """What the Data API gives a Pacific day."""
    per_day = {
        SEARCH: profile.searches_per_day,
        GENERAL: profile.units_per_day,
        STATISTICS: STATISTICS_PER_DAY,
    }
    called = f"the {bucket} quota of the YouTube API"
    return Quota(bucket, called, per_day[bucket], "America/Los_Angeles")
