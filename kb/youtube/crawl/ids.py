"""Video ids from a list, and the share of one machine of several."""

import hashlib
from collections.abc import Callable

from kb.crawl.id_list import IdRules, ListedId
from kb.youtube.addresses import is_unmistakable, video_of

Part = tuple[int, int] | None
"""Which of how many machines, from 1; None for one that does it all."""


def _video_id(entry: ListedId) -> str | None:
    return video_of(entry.value) if isinstance(entry.value, str) else None


RULES = IdRules(
    option="--ids",
    noun="video ids",
    hint="write one per line: 11 characters, or a video's URL",
    columns=(
        *("video_id", "youtube_id", "vid", "id", "key"),
        *("video_url", "youtube_url", "title_url", "webpage_url", "original_url", "url", "link"),
    ),
    tables=(("videos",), ("pairs",)),
    parse=_video_id,
    is_unmistakable=is_unmistakable,
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
