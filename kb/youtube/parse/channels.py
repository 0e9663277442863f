"""Channels whose videos are left out on request: how answers name them.

A tombstone has a digest in place of a channel's id. Where ids of channels stand in answers,
`schemas/raw/youtube/` says (`x-keys`, of "channel" and "uploads"); what is theirs leaves an answer
as what is purged does.
"""

import hashlib
from collections.abc import Collection, Iterator
from functools import lru_cache
from typing import Any

from kb.schema import answer_keys
from kb.schema.coerce import inner
from kb.youtube.parse import answers as parse

CHANNEL, UPLOADS = "channel", "uploads"  # kinds of names
KINDS = ("search", "playlist_items", "playlists", "videos", "ytdlp_info", "ytdlp_playlists")
LISTS = ("UU", "UULF", "UULV", "UUSH")  # before the 22 characters of a channel's id


@lru_cache(1 << 14)
def mark(channel: str) -> str:
    """What stands for a channel in its tombstone."""
    return hashlib.sha256(channel.encode("utf-8", "replace")).hexdigest()[:32]


def channel_of(playlist: str) -> str:
    """The channel of a list of uploads."""
    prefix = max((one for one in LISTS if playlist.startswith(one)), key=len, default="UU")
    return "UC" + playlist[len(prefix) :]


def is_uploads(playlist: str) -> bool:
    """Whether a list is that of a channel's uploads, which nobody made by hand."""
    return playlist.startswith(LISTS)


class LeftOut(Collection[str]):
    """The channels with these marks, by their ids, or with `lists` by their lists of uploads."""

    def __init__(self, marks: Collection[str], *, lists: bool = False) -> None:
        self._marks, self._lists = marks, lists

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        return mark(channel_of(name) if self._lists else name) in self._marks

    def __iter__(self) -> Iterator[str]:
        return iter(())  # their ids are unknown

    def __len__(self) -> int:
        return len(self._marks)


class ChannelFilter:
    """Takes what is of the channels with these marks out of fresh answers."""

    def __init__(self, marks: Collection[str]) -> None:
        self._marks = marks
        self._names = {CHANNEL: LeftOut(marks), UPLOADS: LeftOut(marks, lists=True)}

    def __bool__(self) -> bool:
        return bool(self._marks)

    def __contains__(self, channel: object) -> bool:
        return channel in self._names[CHANNEL]

    def theirs(self, kind: str, params: dict[str, Any], response: Any) -> set[str]:
        """The videos of an answer that are of these channels."""
        pairs = theirs(kind, params, response) if self._marks else ()
        return {key for channel, key in pairs if channel in self}

    def without(
        self, kind: str, params: dict[str, Any], response: Any
    ) -> tuple[dict[str, Any], Any] | None:
        """What was asked and the answer without theirs; None when nothing is left."""
        if not self._marks:
            return params, response
        return answer_keys.without(f"youtube/{kind}", params, response, self._names)


def theirs(kind: str, params: dict[str, Any], response: Any) -> Iterator[tuple[str, str]]:
    """(channel, its video or playlist) of an answer of one of KINDS; "" where it shows a channel
    alone.
    """
    if not isinstance(response, dict):
        return
    items = [one for one in response.get("items") or () if isinstance(one, dict)]
    if kind == "search":
        for one in items:
            channel = inner(one, "id", "channelId") or inner(one, "snippet", "channelId")
            yield str(channel), str(inner(one, "id", "playlistId") or "")
    elif kind == "playlist_items":
        playlist = str(params.get("playlistId", ""))
        channel = channel_of(playlist) if is_uploads(playlist) else ""
        for item in (None, *items) if channel else items:
            owner = channel or str(inner(item, "snippet", "videoOwnerChannelId"))
            yield owner, (parse.listed_video(item) or "") if item else ""
    elif kind in ("videos", "playlists"):
        yield from ((str(inner(one, "snippet", "channelId")), str(one.get("id"))) for one in items)
    elif kind == "ytdlp_info":
        for name in ("channel_id", "uploader_id"):
            yield str(response.get(name)), str(response.get("id"))
    else:
        own = str(response.get("id"))
        entries = [one for one in response.get("entries") or () if isinstance(one, dict)]
        yield from ((str(one.get("channel_id")), str(one.get("id"))) for one in entries)
        listed = "" if own.startswith((*LISTS, "UC")) else own
        yield from ((str(response.get(name)), listed) for name in ("channel_id", "uploader_id"))
        if own.startswith((*LISTS, "UC")):  # all that it lists is the channel's
            channel = own if own.startswith("UC") else channel_of(own)
            yield from ((channel, key) for key in ("", *(str(one.get("id")) for one in entries)))
