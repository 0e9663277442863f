"""Plants playlists of the invented channels' videos: tutorials, others that the same phrases find,
and those that a crawl meets trouble with.

A tutorials' playlist has most videos of its channel whose titles name a task, and a few others. All
videos are uploads of channels that are listed, so that playlists change nothing of what is crawled.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

from kb.core import clock
from kb.sandbox.invented_ids import playlist_id
from kb.sandbox.youtube.cases import Channel, Playlist, Video

GONE = "gone"  # of a playlist that was deleted since a search was asked for it
_TAUGHT, _STRAY = 0.8, 0.12  # of a channel's videos that name a task, and of its others
_OTHERS = ("Music", "Funny Moments", "Livestreams")


def planted_playlists(
    seed: int, channels: Sequence[Channel], phrases: Sequence[str]
) -> list[Playlist]:
    """The playlists of a world; `phrases`: what searches ask for, the titles of tutorials' begin
    with.
    """
    owners = [channel for channel in channels if channel.listed and channel.videos]
    if not owners or not phrases:
        return []
    made = []
    for number, channel in enumerate(owners):
        rng = clock.rng(seed, "playlist", number)
        taught = [one for one in channel.videos if rng.random() < (_TAUGHT if one.task else _STRAY)]
        phrase = phrases[number % len(phrases)]
        made.append(_playlist(rng, f"{phrase} & more: {channel.title}", channel, taught))
        made[-1].teaches = True
    rng = clock.rng(seed, "playlist", "others")
    for number, words in enumerate(_OTHERS):
        owner = owners[number % len(owners)]
        entries = [one for one in owner.videos if not one.task][:40]
        title = f"{phrases[-1]} {words}" if number < 2 else words
        made.append(_playlist(rng, title, owner, entries))
    made[0].entries += made[0].entries[:1]  # the same video at the end again
    for privacy in ("private", GONE, "unlisted"):
        made.append(_playlist(rng, f"{phrases[0]} {privacy}", owners[0], owners[0].videos[:3]))
        made[-1].privacy = privacy
    made.append(_playlist(rng, f"{phrases[0]} to come", owners[0], []))
    return made


def _playlist(
    rng: random.Random, title: str, channel: Channel, entries: Sequence[Video]
) -> Playlist:
    order = list(entries)
    rng.shuffle(order)
    return Playlist(playlist_id(rng), title, channel, order)
