"""What an answer means for the frontier: the same function live and when the raw log is replayed, so idempotent.

searches      key "<keyword>#<page token>", payload {q, token, page, channels: found on it}
                                                → channels, and the next page
channels      key channel id: found, never asked for by itself
uploads       key channel id, payload {playlist, token}: pages of the uploads list → videos
videos        key video id: metadata → transcripts, for those that pass the cheap filters
transcripts   key video id
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import Any

from kb.core.profile.youtube import YouTube
from kb.store import rawlog
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope
from kb.youtube import parse

SEARCHES, CHANNELS, UPLOADS, VIDEOS, TRANSCRIPTS, REFRESH = (
    "searches",
    "channels",
    "uploads",
    "videos",
    "transcripts",
    "refresh",
)
ASKED = (SEARCHES, UPLOADS, VIDEOS, TRANSCRIPTS)  # what a crawl asks for
# raw kinds
RAW_SEARCH, RAW_LIST, RAW_VIDEOS, RAW_TRANSCRIPTS = (
    "search",
    "playlist_items",
    "videos",
    "transcripts",
)
FINAL = {"ok", "none", "disabled", "unavailable", "age_restricted"}
BEYOND = "beyond search_pages"  # why a page of a search is skipped

_log = logging.getLogger("kb.youtube")

Wanted = Callable[[Any], Iterable[str]]


def uploads_list(channel_id: str, profile: YouTube) -> str:
    """The id of a channel's uploads list: UU…, or UULF… which leaves Shorts out."""
    return ("UULF" if profile.uploads == "no_shorts" else "UU") + channel_id[2:]


def channel_of(playlist: str) -> str:
    """The channel of an uploads list."""
    return "UC" + (playlist[4:] if playlist.startswith("UULF") else playlist[2:])


class Effects:
    """Takes envelopes into the frontier. `wanted` picks from parsed videos those whose transcript is worth asking for."""

    def __init__(
        self, profile: YouTube, wanted: Wanted, mine: Callable[[str], bool], purged: set[str]
    ) -> None:
        self._profile, self._wanted, self._mine, self._purged = profile, wanted, mine, purged

    def __call__(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """The effect of one envelope."""
        if kind == RAW_SEARCH:
            self._search(frontier, envelope)
        elif kind == RAW_LIST:
            self._list(frontier, envelope)
        elif kind == RAW_VIDEOS:
            self._videos(frontier, envelope)
        elif kind == RAW_TRANSCRIPTS:
            self._transcript(frontier, envelope)

    def _search(self, frontier: Frontier, envelope: Envelope) -> None:
        keyword, token = (
            str(envelope.request.params.get("q", "")),
            envelope.request.params.get("pageToken"),
        )
        key = search_key(keyword, token)
        known = frontier.get(SEARCHES, key)
        page = known[1]["page"] if known and known[1] else 1
        hits = [
            channel for channel in parse.channel_hits(envelope.response) if channel.startswith("UC")
        ]
        frontier.add(CHANNELS, hits)
        frontier.done(CHANNELS, *hits)
        mine = [channel for channel in hits if self._mine(channel)]
        frontier.add(
            UPLOADS,
            [
                (channel, {"playlist": uploads_list(channel, self._profile), "token": None})
                for channel in mine
            ],
        )
        following = parse.next_page(envelope.response)
        if following and hits:
            frontier.add(
                SEARCHES,
                [
                    (
                        search_key(keyword, following),
                        {"q": keyword, "token": following, "page": page + 1},
                    )
                ],
            )
        frontier.add(SEARCHES, [(key, None)])
        found = {"q": keyword, "token": token, "page": page, "channels": len(hits)}
        frontier.payload(SEARCHES, key, found)
        frontier.done(SEARCHES, key)

    def _list(self, frontier: Frontier, envelope: Envelope) -> None:
        playlist, token = (
            str(envelope.request.params.get("playlistId", "")),
            envelope.request.params.get("pageToken"),
        )
        channel = channel_of(playlist)
        known = frontier.get(UPLOADS, channel)
        if known is None:
            frontier.add(UPLOADS, [(channel, {"playlist": playlist, "token": token})])
        elif known[1]["token"] != token or known[1]["playlist"] != playlist or known[0] == "done":
            # An answer of another machine, or a page seen before: its videos count, the place in the list stays.
            self._add_videos(frontier, envelope.response)
            return
        if envelope.status == 404:
            if playlist.startswith("UULF"):
                frontier.payload(UPLOADS, channel, {"playlist": "UU" + playlist[4:], "token": None})
                frontier.release(UPLOADS, channel)
            else:
                frontier.skip(UPLOADS, channel, "not_found")
            return
        new = self._add_videos(frontier, envelope.response)
        following = parse.next_page(envelope.response)
        pages, mark = (
            known[1].get("pages", 0) + 1 if known else 1,
            known[1].get("mark") if known else None,
        )
        if following and new == 0 and following in (mark, token):
            _log.warning(
                "the list %s goes round: page %s leads back to one that was read; taken as its end",
                playlist,
                pages,
            )
            following = None
        later_round = frontier.cursor("round", 1) > 1
        if following and not (later_round and new == 0):
            # The token after every 1st, 2nd, 4th, 8th … page is remembered: it comes again where pages go round.
            mark = following if pages & (pages - 1) == 0 else mark
            frontier.payload(
                UPLOADS,
                channel,
                {"playlist": playlist, "token": following, "pages": pages, "mark": mark},
            )
            frontier.release(UPLOADS, channel)
        else:
            # Lists are newest first: in a later round a page of known videos ends it.
            frontier.payload(
                UPLOADS, channel, {"playlist": uploads_list(channel, self._profile), "token": None}
            )
            frontier.done(UPLOADS, channel)

    def _add_videos(self, frontier: Frontier, response: Any) -> int:
        return frontier.add(
            VIDEOS, [key for key in parse.listed(response) if key not in self._purged]
        )

    def _videos(self, frontier: Frontier, envelope: Envelope) -> None:
        asked = parse.requested(envelope.request.params)
        frontier.add(VIDEOS, asked)
        frontier.done(VIDEOS, *asked)
        frontier.done(REFRESH, *asked)
        for rows in parse.videos([rawlog.encode(envelope)]):
            frontier.add(
                TRANSCRIPTS, [key for key in self._wanted(rows) if key not in self._purged]
            )

    def _transcript(self, frontier: Frontier, envelope: Envelope) -> None:
        answer = envelope.response if isinstance(envelope.response, dict) else {}
        key = str(answer.get("video_id", ""))
        frontier.add(TRANSCRIPTS, [key])
        if answer.get("outcome") in FINAL:
            frontier.done(TRANSCRIPTS, key)
        else:
            frontier.error(TRANSCRIPTS, key, str(answer.get("reason") or "failed"))


def without_channels(frontier: Frontier, keywords: Iterable[str]) -> list[str]:
    """The keywords whose search was answered and found no channel."""
    found = []
    # A state of before the count was kept tells only where no search found any.
    uncounted = None if frontier.counts(CHANNELS) else 0
    for word in dict.fromkeys(keywords):
        status, payload, _ = frontier.get(SEARCHES, search_key(word, None)) or ("", None, None)
        if status == "done" and (payload or {}).get("channels", uncounted) == 0:
            found.append(word)
    return found


def crawled(frontier: Frontier) -> int:
    """Videos that the API answered for in all runs, missing ones among them."""
    return frontier.counts(VIDEOS).get("done", 0)


def search_key(keyword: str, token: str | None) -> str:
    """The frontier's key of a page of a search."""
    return f"{keyword}#{token or ''}"
