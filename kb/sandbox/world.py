"""One small invented world, the same for a seed on every machine. Services show parts of it.

Nothing in it was taken from a real site: channels, titles, descriptions and speech are put together
here from word lists of our own.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kb.sandbox.videos import Catalogue


class World:
    """What the services show.

    `n_channels`, `n_videos`: size of the YouTube part (the first videos cover every case once, see
    kb/sandbox/videos.py). `wiki_state`: "first" or "later". Services keep what they change to themselves.
    """

    def __init__(self, seed: int = 0, *, n_channels: int = 12, n_videos: int = 300, wiki_state: str = "first") -> None:
        self.seed = seed
        self.n_channels = n_channels
        self.n_videos = n_videos
        self.wiki_state = wiki_state

    @cached_property
    def youtube(self) -> Catalogue:
        """Channels and videos."""
        from kb.sandbox.videos import Catalogue

        return Catalogue(self.seed, self.n_channels, self.n_videos)
