"""What an answer means for the frontier: the same live and when the raw log is replayed, so
idempotent.

searches      key "<keyword>#<page token>", payload Search → channels, and the next page
playlist_searches     the same → playlists
channels      key channel id: found, never asked for by itself
uploads       key channel id, payload ListPlace: pages of the uploads list → videos
playlists     key playlist id, payload ListPlace: pages of the playlist → videos
playlist_facts        key playlist id: title, owner and who may see it, of those that no search
              found or that are to be read again
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
from kb.youtube.parse.channels import channel_of, is_uploads
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
PLAYLIST_SEARCHES, PLAYLISTS, PLAYLIST_FACTS = "playlist_searches", "playlists", "playlist_facts"
# raw kinds
RAW_SEARCH, RAW_LIST, RAW_VIDEOS, RAW_TRANSCRIPTS, RAW_STATISTICS = (
    "search",
    "playlist_items",
    "videos",
    "transcripts",
    "statistics",
)
RAW_SECOND_TRACKS, RAW_FACTS = "second_tracks", "playlists"
RAW_INFO, RAW_PLAYLISTS, RAW_SUBTITLES = "ytdlp_info", "ytdlp_playlists", "ytdlp_subtitles"
RAW_OWN = "own_transcripts"  # changes nothing that a crawl asks for
FINAL = {"ok", "none", "disabled", "unavailable", "age_restricted"}
UNJUDGED = "videos not judged"  # cursor: taken in by what asks for no transcript
NO_ACCESS = "playlistItemsNotAccessible"  # why a playlist is skipped: it is private
BEYOND = "beyond search_pages"  # why a page of a search is skipped
ELSEWHERE = "of another part"  # the same

_log = logging.getLogger("kb.youtube")

Wanted = Callable[[Any], Iterable[str]]
"""Picks from parsed videos the ids of those whose transcript is worth asking for."""


def nothing(rows: Any) -> Sequence[str]:
    """For what asks for no transcript."""
    return ()


class SearchItem(msgspec.Struct):
    """A page of a search. `channels` is how many channels or playlists it found, None before it
    was answered.
    """

    q: str
    token: str | None = None
    page: int = 1
    channels: int | None = None


class ListPlace(msgspec.Struct):
    """A place in a playlist, such as that of a channel's uploads: the next page's token, and how
    many pages were read.

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
    PLAYLIST_SEARCHES: SearchItem,
    UPLOADS: ListPlace,
    PLAYLISTS: ListPlace,
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
            RAW_PLAYLISTS: self._imported_list,
            RAW_FACTS: self._facts,
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
        of_playlists = params.get("type") == "playlist"
        kind = PLAYLIST_SEARCHES if of_playlists else SEARCHES
        known = frontier.get(kind, key)
        page = known[1].page if known and known[1] else 1
        if of_playlists:
            every = parse.playlist_hits(envelope.response)
            hits = [key for key in every if key not in self._purged]
            self._add_lists(frontier, PLAYLISTS, hits)
        else:
            channels = filter(_is_channel, parse.channel_hits(envelope.response))
            hits = [key for key in channels if key not in self._left_out]
            frontier.add_keys(CHANNELS, hits)
            frontier.done(CHANNELS, *hits)
            self._add_lists(frontier, UPLOADS, hits)
        following = parse.next_page(envelope.response)
        if following and hits:
            after = SearchItem(keyword, following, page + 1)
            frontier.add_keys(kind, [(search_key(keyword, following), after)])
        frontier.add_keys(kind, [(key, None)])
        frontier.payload(kind, key, SearchItem(keyword, token, page, len(hits)))
        frontier.done(kind, key)

    def _seeds(self, frontier: Frontier, envelope: Envelope) -> None:
        asked = envelope.request.params
        frontier.add_keys(VIDEOS, [key for key in asked.get("ids", []) if key not in self._purged])
        lists = [key for key in asked.get("playlists", []) if key not in self._purged]
        self._add_lists(frontier, PLAYLISTS, lists)
        frontier.add_keys(PLAYLIST_FACTS, [key for key in lists if self._mine(key)])

    def _add_lists(self, frontier: Frontier, kind: str, keys: Iterable[str]) -> None:
        mine = filter(self._mine, keys)
        frontier.add_keys(kind, [(key, self._from_the_top(kind, key)) for key in mine])

    def _from_the_top(self, kind: str, key: str) -> ListPlace:
        return ListPlace(uploads_list(key, self._profile) if kind == UPLOADS else key)

    def _list(self, frontier: Frontier, envelope: Envelope) -> None:
        params = envelope.request.params
        playlist, token = str(params.get("playlistId", "")), params.get("pageToken")
        kind, key = list_item(playlist)
        if not self._mine(key):
            return  # an answer of another part, whose videos these are
        known = frontier.get(kind, key)
        if known is None:
            at = ListPlace(playlist, token)
            frontier.add_keys(kind, [(key, at)])
        else:
            at = known[1]
            if (at.playlist, at.token) != (playlist, token) or known[0] == "done":
                # An answer of another machine, or a page that was read before: its videos count,
                # the place in the list stays.
                self._add_videos(frontier, envelope.response)
                return
        if envelope.status == 404:
            self._no_list(frontier, kind, key, playlist)
            return
        if envelope.status == 403:
            frontier.skip(kind, key, NO_ACCESS)
            return
        new = self._add_videos(frontier, envelope.response)
        following = self._next_of(at, parse.next_page(envelope.response), new)
        later_round = frontier.cursor("round", 1) > 1
        if following is None or (later_round and new == 0 and kind == UPLOADS):
            # Uploads are newest first: in a later round a page of known videos ends their list.
            frontier.payload(kind, key, self._from_the_top(kind, key))
            frontier.done(kind, key)
            return
        pages = at.pages + 1
        # The token after every 1st, 2nd, 4th, 8th … page is remembered: where pages go round it
        # comes again.
        mark = following if pages & (pages - 1) == 0 else at.mark
        frontier.payload(kind, key, ListPlace(playlist, following, pages, mark))
        frontier.mark(kind, [key], "todo")

    def _no_list(self, frontier: Frontier, kind: str, key: str, playlist: str) -> None:
        """Not every channel has a list without Shorts; one without any list has no uploads."""
        if not playlist.startswith("UULF"):
            frontier.skip(kind, key, "not_found")
            return
        frontier.payload(kind, key, ListPlace("UU" + playlist[4:]))
        frontier.mark(kind, [key], "todo")

    def _next_of(self, at: ListPlace, following: str | None, new: int) -> str | None:
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

    def _facts(self, frontier: Frontier, envelope: Envelope) -> None:
        asked = parse.requested(envelope.request.params)
        frontier.add_keys(PLAYLIST_FACTS, asked)
        frontier.done(PLAYLIST_FACTS, *asked)

    def _imported_list(self, frontier: Frontier, envelope: Envelope) -> None:
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


def list_item(playlist: str) -> tuple[str, str]:
    """The kind and the key of a list in the frontier."""
    return (UPLOADS, channel_of(playlist)) if is_uploads(playlist) else (PLAYLISTS, playlist)


def _is_channel(key: str) -> bool:
    return key.startswith("UC")


def unproductive_words(frontier: Frontier, kind: str, words: Iterable[str]) -> list[str]:
    """The words whose search was answered and found nothing."""
    unproductive = []
    for word in dict.fromkeys(words):
        status, page, _ = frontier.get(kind, search_key(word, None)) or ("", None, None)
        if status == "done" and page is not None and page.channels == 0:
            unproductive.append(word)
    return unproductive


def crawled(frontier: Frontier) -> int:
    """Videos that the API answered for in all runs, missing ones among them."""
    return frontier.counts(VIDEOS).get("done", 0)


def search_key(keyword: str, token: str | None) -> str:
    return f"{keyword}#{token or ''}"
