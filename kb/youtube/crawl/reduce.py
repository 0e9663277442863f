"""What an answer means for the frontier: the same live and when the raw log is replayed, so
idempotent.

searches      key "<keyword>#<page token>", payload Search → channels, and the next page
channels      key channel id: found, never asked for by itself
uploads       key channel id, payload Uploads: pages of the uploads list → videos
videos        key video id: metadata → transcripts, for those that pass the cheap filters
transcripts   key video id
statistics    key video id: counts to be read again → refresh, for those that are left out
refresh       key video id: metadata to be read again
second_tracks key video id: the automatic track of a video whose transcript is a manual one
"""

import logging
from collections.abc import Callable, Collection, Container, Iterable, Sequence
from functools import partial
from typing import Any

import msgspec
import pyarrow as pa

from kb.store.rawlog.rawlog import SEEDS, Envelope
from kb.store.state.frontier import Frontier
from kb.youtube.parse import answers as parse
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.parse.channels import channel_of
from kb.youtube.section import YouTubeSection
from kb.youtube.ytdlp.tracks import TrackLanguage

SEARCHES, CHANNELS, UPLOADS, VIDEOS, TRANSCRIPTS, REFRESH, STATISTICS, SECOND_TRACKS = (
    "searches",
    "channels",
    "uploads",
    "videos",
    "transcripts",
    "refresh",
    "statistics",
    "second_tracks",
)
# raw kinds
RAW_SEARCH, RAW_LIST, RAW_VIDEOS, RAW_TRANSCRIPTS, RAW_STATISTICS = (
    "search",
    "playlist_items",
    "videos",
    "transcripts",
    "statistics",
)
RAW_SECOND_TRACKS = "second_tracks"
RAW_INFO, RAW_PLAYLISTS, RAW_SUBTITLES = "ytdlp_info", "ytdlp_playlists", "ytdlp_subtitles"
RAW_OWN = "own_transcripts"  # changes nothing that a crawl asks for
FINAL = {"ok", "none", "disabled", "unavailable", "age_restricted"}
UNJUDGED = "videos not judged"  # cursor: taken in by what asks for no transcript
BEYOND = "beyond search_pages"  # why a page of a search is skipped
ELSEWHERE = "of another part"  # the same

_log = logging.getLogger("kb.youtube")

Wanted = Callable[[Any], Iterable[str]]
"""Picks from parsed videos the ids of those whose transcript is worth asking for."""


def nothing(rows: Any) -> Sequence[str]:
    """For what asks for no transcript."""
    return ()


class SearchItem(msgspec.Struct):
    """A page of a search. `channels` is how many it found, None before it was answered."""

    q: str
    token: str | None = None
    page: int = 1
    channels: int | None = None


class Uploads(msgspec.Struct):
    """A place in a channel's uploads list: the next page's token, and how many were read.

    `mark` is an earlier token, to find out that the list goes round.
    """

    playlist: str
    token: str | None = None
    pages: int = 0
    mark: str | None = None


class Transcript(msgspec.Struct):
    """`po_token`: the day (UTC) on which the track asked for a PO token, "2026-11-20"."""

    po_token: str | None = None


PAYLOADS: dict[str, type[msgspec.Struct]] = {
    SEARCHES: SearchItem,
    UPLOADS: Uploads,
    TRANSCRIPTS: Transcript,
}


def uploads_list(channel_id: str, profile: YouTubeSection) -> str:
    """The id of a channel's uploads list: UU…, or UULF… which leaves Shorts out."""
    return ("UULF" if profile.uploads == "no_shorts" else "UU") + channel_id[2:]


class Reducer:
    """Takes envelopes into the frontier. `mine` tells a part's channels, and with `by_id` its
    videos, which elsewhere are those of its channels; `purged` are videos, `left_out` channels that
    are left out.
    """

    def __init__(
        self,
        profile: YouTubeSection,
        wanted: Wanted,
        mine: Callable[[str], bool],
        purged: Collection[str],
        left_out: Container[str] = (),
        *,
        by_id: bool = False,
    ) -> None:
        self._left_out, self._owner = left_out, "video_id" if by_id else "channel_id"
        self._profile, self._wanted, self._mine, self._purged = profile, wanted, mine, purged
        self._language = TrackLanguage(profile.language, profile.translate)
        self._ways: dict[str, Callable[[Frontier, Envelope], None]] = {
            RAW_SEARCH: self._search,
            RAW_LIST: self._list,
            RAW_VIDEOS: self._videos,
            RAW_TRANSCRIPTS: partial(self._transcript, TRANSCRIPTS),
            RAW_SECOND_TRACKS: partial(self._transcript, SECOND_TRACKS),
            RAW_STATISTICS: self._statistics,
            RAW_INFO: self._info,
            RAW_SUBTITLES: self._subtitles,
            RAW_PLAYLISTS: self._playlist,
            SEEDS: self._seeds,
        }

    @property
    def wants(self) -> bool:
        """Whether any video's transcript may be asked for."""
        return self._wanted is not nothing

    def __call__(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """The effect of one envelope; other raw kinds have none."""
        way = self._ways.get(kind)
        if way is not None:
            way(frontier, envelope)

    def _search(self, frontier: Frontier, envelope: Envelope) -> None:
        params = envelope.request.params
        keyword, token = str(params.get("q", "")), params.get("pageToken")
        key = search_key(keyword, token)
        known = frontier.get(SEARCHES, key)
        page = known[1].page if known and known[1] else 1
        channels = (key for key in parse.channel_hits(envelope.response) if key.startswith("UC"))
        hits = [key for key in channels if key not in self._left_out]
        frontier.add_keys(CHANNELS, hits)
        frontier.done(CHANNELS, *hits)
        mine = [channel for channel in hits if self._mine(channel)]
        frontier.add_keys(UPLOADS, [(key, self._from_the_top(key)) for key in mine])
        following = parse.next_page(envelope.response)
        if following and hits:
            after = SearchItem(keyword, following, page + 1)
            frontier.add_keys(SEARCHES, [(search_key(keyword, following), after)])
        frontier.add_keys(SEARCHES, [(key, None)])
        frontier.payload(SEARCHES, key, SearchItem(keyword, token, page, len(hits)))
        frontier.done(SEARCHES, key)

    def _seeds(self, frontier: Frontier, envelope: Envelope) -> None:
        ids = envelope.request.params.get("ids", [])
        frontier.add_keys(VIDEOS, [key for key in ids if key not in self._purged])

    def _from_the_top(self, channel: str) -> Uploads:
        return Uploads(uploads_list(channel, self._profile))

    def _list(self, frontier: Frontier, envelope: Envelope) -> None:
        params = envelope.request.params
        playlist, token = str(params.get("playlistId", "")), params.get("pageToken")
        channel = channel_of(playlist)
        if not self._mine(channel):
            return  # an answer of another part, whose videos these are
        known = frontier.get(UPLOADS, channel)
        if known is None:
            at = Uploads(playlist, token)
            frontier.add_keys(UPLOADS, [(channel, at)])
        else:
            at = known[1]
            if (at.playlist, at.token) != (playlist, token) or known[0] == "done":
                # An answer of another machine, or a page that was read before: its videos count,
                # the place in the list stays.
                self._add_videos(frontier, envelope.response)
                return
        if envelope.status == 404:
            self._no_list(frontier, channel, playlist)
            return
        new = self._add_videos(frontier, envelope.response)
        following = self._next_of(at, parse.next_page(envelope.response), new)
        later_round = frontier.cursor("round", 1) > 1
        if following is None or (later_round and new == 0):
            # Lists are newest first: in a later round a page of known videos ends it.
            frontier.payload(UPLOADS, channel, self._from_the_top(channel))
            frontier.done(UPLOADS, channel)
            return
        pages = at.pages + 1
        # The token after every 1st, 2nd, 4th, 8th … page is remembered: where pages go round it
        # comes again.
        mark = following if pages & (pages - 1) == 0 else at.mark
        frontier.payload(UPLOADS, channel, Uploads(playlist, following, pages, mark))
        frontier.mark(UPLOADS, [channel], "todo")

    def _no_list(self, frontier: Frontier, channel: str, playlist: str) -> None:
        """Not every channel has a list without Shorts; one without any list has no uploads."""
        if not playlist.startswith("UULF"):
            frontier.skip(UPLOADS, channel, "not_found")
            return
        frontier.payload(UPLOADS, channel, Uploads("UU" + playlist[4:]))
        frontier.mark(UPLOADS, [channel], "todo")

    def _next_of(self, at: Uploads, following: str | None, new: int) -> str | None:
        """The token of the next page; None at the end, also of a list that goes round."""
        if following is None or new or following not in (at.mark, at.token):
            return following
        _log.warning(
            "the list %s loops: page %s leads back to an earlier page, which is taken as the end",
            at.playlist,
            at.pages + 1,
        )
        return None

    def _add_videos(self, frontier: Frontier, response: Any) -> int:
        keys = [key for key in parse.listed(response) if key not in self._purged]
        return frontier.add_keys(VIDEOS, keys)

    def _videos(self, frontier: Frontier, envelope: Envelope) -> None:
        asked = parse.requested(envelope.request.params)
        frontier.add_keys(VIDEOS, asked)
        frontier.done(VIDEOS, *asked)
        frontier.done(REFRESH, *asked)
        if self.wants:
            for rows in parse.videos_of(envelope):
                self.judge(frontier, rows)
        else:
            frontier.set_cursor(UNJUDGED, True)

    def _statistics(self, frontier: Frontier, envelope: Envelope) -> None:
        params = envelope.request.params
        frontier.add_keys(REFRESH, parse.missing(params, envelope.response))
        asked = parse.requested(params)
        frontier.add_keys(STATISTICS, asked)
        frontier.done(STATISTICS, *asked)
        # Counts alone decide nothing: a crawl judges them with the metadata.
        frontier.set_cursor(UNJUDGED, True)

    def _info(self, frontier: Frontier, envelope: Envelope) -> None:
        """An imported video is not asked for; a crawl judges whether its transcript is."""
        key = str(envelope.response["id"])
        frontier.add_keys(VIDEOS, [key])
        frontier.done(VIDEOS, key)
        frontier.set_cursor(UNJUDGED, True)

    def _subtitles(self, frontier: Frontier, envelope: Envelope) -> None:
        key, language = str(envelope.response["video_id"]), str(envelope.response["language"])
        if self._language.spoken(language):
            frontier.add_keys(TRANSCRIPTS, [key])
            frontier.done(TRANSCRIPTS, key)

    def _playlist(self, frontier: Frontier, envelope: Envelope) -> None:
        keys = (str(entry["id"]) for entry in envelope.response["entries"])
        frontier.add_keys(VIDEOS, [key for key in keys if key not in self._purged])

    def judge(self, frontier: Frontier, videos: pa.Table) -> None:
        """Add the transcripts that are worth asking for, of parsed videos."""
        owners = dict(
            zip(*(videos[name].to_pylist() for name in ("video_id", self._owner)), strict=True)
        )
        wanted = (key for key in self._wanted(videos) if key not in self._purged)
        frontier.add_keys(TRANSCRIPTS, [key for key in wanted if self._mine(owners[key] or "")])

    def _transcript(self, kind: str, frontier: Frontier, envelope: Envelope) -> None:
        key, status, reason = _outcome(envelope.response)
        frontier.add_keys(kind, [key])
        frontier.mark(kind, [key], status, reason)
        if reason == PO_TOKEN and kind == TRANSCRIPTS:
            frontier.payload(TRANSCRIPTS, key, Transcript((envelope.fetched_at or "")[:10]))


def with_po_token(frontier: Frontier) -> int:
    """Videos whose transcript asks for a PO token, as far as they were asked for."""
    items = frontier.items(TRANSCRIPTS, "skipped")
    return sum(reason == PO_TOKEN for _, _, reason, _ in items)


def _outcome(response: Any) -> tuple[str, str, str | None]:
    """What an answer about a transcript says of its item: (key, status, reason)."""
    answer = response if isinstance(response, dict) else {}
    key = str(answer.get("video_id", ""))
    if answer.get("outcome") in FINAL:
        return key, "done", None
    if answer.get("outcome") == PO_TOKEN:
        return key, "skipped", PO_TOKEN
    return key, "error", str(answer.get("reason") or "failed")


def keywords_without_channels(frontier: Frontier, keywords: Iterable[str]) -> list[str]:
    """The keywords whose search was answered and found no channel."""
    unproductive = []
    for word in dict.fromkeys(keywords):
        status, page, _ = frontier.get(SEARCHES, search_key(word, None)) or ("", None, None)
        if status == "done" and page is not None and page.channels == 0:
            unproductive.append(word)
    return unproductive


def crawled(frontier: Frontier) -> int:
    """Videos that the API answered for in all runs, missing ones among them."""
    return frontier.counts(VIDEOS).get("done", 0)


def search_key(keyword: str, token: str | None) -> str:
    return f"{keyword}#{token or ''}"
