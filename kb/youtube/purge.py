"""What a purge has to know about YouTube: videos that vanished leave everything."""

from kb.artifacts.measures import count_pairs, read_measures
from kb.artifacts.purge import Purge, PurgeRules
from kb.artifacts.purge_rows import RowLocation, location_of, shared_locations
from kb.store.layout import BELOW, Layout
from kb.youtube import channels
from kb.youtube.crawl.ids import RULES as IDS
from kb.youtube.crawl.reduce import (
    CHANNELS,
    RAW_SECOND_TRACKS,
    RAW_STATISTICS,
    RAW_TRANSCRIPTS,
    RAW_VIDEOS,
    REFRESH,
    SECOND_TRACKS,
    STATISTICS,
    TRANSCRIPTS,
    UPLOADS,
    VIDEOS,
)
from kb.youtube.crawl.refresh import newest
from kb.youtube.parse.channels import CHANNEL


def find(purge: Purge) -> dict[str, str]:
    """Videos that the API no longer returns ("vanished")."""
    read = newest(purge.root, RAW_VIDEOS)
    return dict.fromkeys((key for key, last in read.items() if not last.there), "vanished")


def repair(purge: Purge) -> None:
    """Count the pairs again that are left."""
    folder = Layout(purge.root).pairs
    if samples := read_measures(folder):
        count_pairs(purge.root, folder, samples)


def forget(purge: Purge) -> None:
    """Forget channels that are left out."""
    for kind in (CHANNELS, UPLOADS):
        purge.frontier.remove(kind, purge.names.get(CHANNEL, ()))


RULES = PurgeRules(
    "youtube",
    IDS.read_some,
    rows=(
        *(location_of(f"youtube/{name}", "video_id") for name in ("videos", "transcripts")),
        location_of("pairs/pairs", "video_id"),
        # A pair whose first copy goes has no figures until the next `kb pairs`.
        *(location_of("pairs/quality", name) for name in ("video_id", "duplicate_video_id")),
        *(location_of(f"tasks/{name}", "video_id") for name in ("tasks", "titles")),
        location_of("open-text/open_text", "video_id"),
        location_of("labels/labels", "video_id"),
        *shared_locations("youtube"),
        *(
            RowLocation(str(BELOW.restored("youtube", name)), f"youtube/{name}", "video_id")
            for name in ("videos", "transcripts")
        ),
        RowLocation(str(BELOW.restored("youtube")), "shared/missing", "key"),
        RowLocation(str(BELOW.restored("pairs")), "pairs/pairs", "video_id"),
    ),
    items=(VIDEOS, TRANSCRIPTS, REFRESH, STATISTICS, SECOND_TRACKS),
    exact=(RAW_VIDEOS, RAW_TRANSCRIPTS, RAW_STATISTICS, RAW_SECOND_TRACKS),
    find=find,
    forget=forget,
    repair=repair,
    people=channels.RULES,
)
