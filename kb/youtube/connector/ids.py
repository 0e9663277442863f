"""Video ids from a list, and the share of one machine of several."""

import hashlib
import re
from collections.abc import Callable

from kb.crawl.id_list import IdRules, ListedId

Part = tuple[int, int] | None
"""Which of how many machines, from 1; None for one that does it all."""

_ID = re.compile(r"(?:^|[=/])([A-Za-z0-9_-]{11})(?:$|[?&#])")
_ARCHIVED = re.compile(r"youtube ([A-Za-z0-9_-]{11})")  # a line of yt-dlp's download archive


def _video_id(entry: ListedId) -> str | None:
    value = str(entry.value).strip()
    match = _ARCHIVED.fullmatch(value) or _ID.search(value)
    return match[1] if match else None


RULES = IdRules(
    option="--ids",
    noun="video ids",
    hint="write one per line: 11 characters, or a video's URL",
    columns=("video_id", "videoid", "youtube_id", "vid", "id", "key", "url", "link"),
    tables=(("videos",), ("pairs",)),
    parse=_video_id,
)


def share(part: Part) -> Callable[[str], bool]:
    """Whether a key belongs to the part: the same on every machine, and every key to one."""
    if part is None:
        return lambda key: True
    number, count = part

    def mine(key: str) -> bool:
        return (
            int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "big") % count == number - 1
        )

    return mine
