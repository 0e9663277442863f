"""Which playlist an imported video was found in."""

from pathlib import Path

from kb.store.rawlog import rawlog
from kb.youtube.connector.reduce import RAW_PLAYLISTS

_OWN = ("UU", "UC")  # all that a channel uploaded is no playlist that somebody made


def playlists(root: Path) -> dict[str, str]:
    """By video, the first playlist by id that lists it. Raises DamagedData."""
    first: dict[str, str] = {}
    for envelope in rawlog.read(root, "youtube", RAW_PLAYLISTS):
        playlist = str(envelope.response["id"])
        for entry in () if playlist.startswith(_OWN) else envelope.response["entries"]:
            video = str(entry["id"])
            first[video] = min(playlist, first.get(video, playlist))
    return first
