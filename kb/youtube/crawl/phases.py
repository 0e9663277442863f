"""The phases of a crawl, which of them `--only` and `--ids` choose, and what is searched for."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from kb.crawl.connector import Phase
from kb.youtube.crawl.fetch import PACK
from kb.youtube.crawl.quota import API, GENERAL, SEARCH, WEB
from kb.youtube.crawl.reduce import (
    PLAYLIST_FACTS,
    PLAYLIST_SEARCHES,
    PLAYLISTS,
    SEARCHES,
    TRANSCRIPTS,
    UPLOADS,
    VIDEOS,
)
from kb.youtube.section import YouTubeSection

PLAYLISTS_READ = Phase(
    kind=PLAYLIST_FACTS,
    unit="playlists",
    name="playlist titles",
    batch=PACK,
    packed=True,
    service=API,
    bucket=GENERAL,
)
PLAYLIST_PAGES = Phase(kind=PLAYLISTS, unit="pages", feeds=(VIDEOS,), service=API, bucket=GENERAL)
PHASES = (
    Phase(
        kind=VIDEOS,
        unit="videos",
        name="metadata",
        feeds=(TRANSCRIPTS,),
        batch=PACK,
        packed=True,
        service=API,
        bucket=GENERAL,
    ),
    Phase(kind=UPLOADS, unit="pages", feeds=(VIDEOS,), service=API, bucket=GENERAL),
    PLAYLIST_PAGES,
    PLAYLISTS_READ,
    Phase(kind=SEARCHES, unit="pages", feeds=(UPLOADS,), service=API, bucket=SEARCH),
    Phase(
        kind=PLAYLIST_SEARCHES,
        unit="pages",
        name="playlist searches",
        feeds=(PLAYLISTS,),
        service=API,
        bucket=SEARCH,
    ),
    # So many that fail one after the other are the site's trouble, not the videos'.
    Phase(kind=TRANSCRIPTS, unit="videos", workers=4, down=6, service=WEB),
)
# By the word of --only: its kinds, of which --limit counts the last one.
ONLY: dict[str, tuple[str, ...]] = {
    "channels": (SEARCHES,),
    "playlists": (PLAYLIST_SEARCHES, PLAYLIST_FACTS, PLAYLISTS),
    "uploads": (UPLOADS,),
    "metadata": (VIDEOS,),
    "transcripts": (TRANSCRIPTS,),
}
_BY_ID = {VIDEOS, TRANSCRIPTS, PLAYLISTS, PLAYLIST_FACTS}


def words_of(profile: YouTubeSection) -> dict[str, tuple[str, ...]]:
    """The words of each kind of search."""
    return {SEARCHES: profile.keywords, PLAYLIST_SEARCHES: profile.playlist_keywords}


def chosen_phases(phases: Sequence[Phase], only: str | None, ids: Path | None) -> list[Phase]:
    """The phases of a run; `--limit` counts videos, or what the one phase handles."""
    kinds = _BY_ID if ids else {phase.kind for phase in phases}
    if only:
        kinds = {*ONLY[only]}
    counted = ONLY[only][-1] if only else VIDEOS
    return [
        replace(phase, limited=phase.kind == counted) for phase in phases if phase.kind in kinds
    ]
