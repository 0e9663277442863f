"""What to ask the Data API and the web site for, and how the answer is recorded."""

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from kb.core.config.addresses import is_loopback
from kb.core.errors import ItemFinal, Retryable
from kb.crawl.connector import Answer, Opened
from kb.crawl.limits import check_length
from kb.net.rate import Pace
from kb.store.state.frontier import Item
from kb.youtube.crawl.client import YouTubeApi
from kb.youtube.crawl.reduce import (
    PLAYLIST_FACTS,
    PLAYLIST_SEARCHES,
    PLAYLISTS,
    RAW_FACTS,
    RAW_LIST,
    RAW_SEARCH,
    RAW_SECOND_TRACKS,
    RAW_STATISTICS,
    RAW_TRANSCRIPTS,
    RAW_VIDEOS,
    REFRESH,
    SEARCHES,
    SECOND_TRACKS,
    STATISTICS,
    TRANSCRIPTS,
    UPLOADS,
    VIDEOS,
)
from kb.youtube.crawl.transcripts import SITE, Fetcher
from kb.youtube.parse import answers as parse
from kb.youtube.section import YouTubeSection

PACK = 50  # ids a call, and entries a page: the API's largest
PAGES = 2_000  # of a list: the API gives 20,000 videos of a channel's uploads
PARTS = "snippet,contentDetails,statistics,status,player"
FRAME = {"maxWidth": 1920, "maxHeight": 1080}  # of the embed: its shape is the video's

Count = Callable[..., None]


class YouTubeFetcher:
    """Asks for items of a kind. The API for one thread at a time, transcripts for several.

    `count` is given what was had, by the names of the summary, when it was recorded.
    """

    def __init__(self, profile: YouTubeSection, opened: Opened, count: Count) -> None:
        self._profile, self._opened, self._count = profile, opened, count
        local = is_loopback(opened.run.settings.kb_youtube_web or SITE)
        self._pace = Pace(0 if local else 3600 / profile.transcripts_per_hour)
        self._api: YouTubeApi | None = None
        self._idle: list[Fetcher] = []
        self._lock = threading.Lock()
        self._ways: dict[str, Callable[[list[Item]], Iterator[Answer]]] = {
            SEARCHES: partial(self._search, "channel"),
            PLAYLIST_SEARCHES: partial(self._search, "playlist"),
            UPLOADS: partial(self._list, "contentDetails"),
            PLAYLISTS: partial(self._list, "snippet,contentDetails"),
            PLAYLIST_FACTS: self._playlist_facts,
            VIDEOS: self._videos,
            REFRESH: self._videos,
            STATISTICS: self._statistics,
            TRANSCRIPTS: partial(self._transcript, RAW_TRANSCRIPTS),
            SECOND_TRACKS: partial(self._transcript, RAW_SECOND_TRACKS),
        }

    def __call__(self, kind: str, items: list[Item]) -> Iterator[Answer]:
        """The answers. Raises what the API's client and the transcripts' raise."""
        return self._ways[kind](items)

    def close(self) -> None:
        if self._api is not None:
            self._api.close()
        for fetcher in self._idle:
            fetcher.close()

    @property
    def api(self) -> YouTubeApi:
        """The API's client, made when it is first needed."""
        if self._api is None:
            self._api = YouTubeApi(self._profile, self._opened)
        return self._api

    def _search(self, type_: str, items: list[Item]) -> Iterator[Answer]:
        (item,) = items
        params = {
            "q": item.payload.q,
            "type": type_,
            "part": "snippet",
            "maxResults": PACK,
            **_page(item),
        }
        answer = _never_final(lambda: self.api.search(**params))
        yield Answer(RAW_SEARCH, "search.list", params, answer)

    def _list(self, parts: str, items: list[Item]) -> Iterator[Answer]:
        (item,) = items
        check_length(f"the list {item.payload.playlist}", item.payload.pages, PAGES)
        params = {
            "playlistId": item.payload.playlist,
            "part": parts,
            "maxResults": PACK,
            **_page(item),
        }
        answer: dict[str, Any]
        try:
            answer, status = self.api.playlist_items(**params), 200
        except ItemFinal as fact:
            status = 404 if fact.reason == "not_found" else 403
            if status == 403 and item.kind == UPLOADS:
                raise
            answer = {"error": {"code": status}}
        yield Answer(RAW_LIST, "playlistItems.list", params, answer, status)

    def _playlist_facts(self, items: list[Item]) -> Iterator[Answer]:
        params = {"id": ",".join(item.key for item in items), "part": "snippet,status"}
        answer = _never_final(lambda: self.api.playlists(**params))
        yield Answer(RAW_FACTS, "playlists.list", params, answer)

    def _videos(self, items: list[Item]) -> Iterator[Answer]:
        params = {"id": ",".join(item.key for item in items), "part": PARTS, **FRAME}
        answer = _never_final(lambda: self.api.videos(**params))
        yield Answer(RAW_VIDEOS, "videos.list", params, answer)
        self._count(crawled=len(items), missing=len(parse.missing(params, answer)))

    def _statistics(self, items: list[Item]) -> Iterator[Answer]:
        params = {"id": ",".join(item.key for item in items), "part": "id,statistics"}
        answer = _never_final(lambda: self.api.statistics(**params))
        yield Answer(RAW_STATISTICS, "videos.batchGetStats", params, answer)
        # What was left out is counted when videos.list has answered for it.
        self._count(crawled=len(items) - len(parse.missing(params, answer)))

    def _transcript(self, kind: str, items: list[Item]) -> Iterator[Answer]:
        (item,) = items
        with self._lock:  # one that no other thread has
            fetcher = self._idle.pop() if self._idle else None
        if fetcher is None:
            fetcher = Fetcher(self._profile, self._pace, self._opened)
        second = kind == RAW_SECOND_TRACKS
        try:
            answer = fetcher.fetch(item.key, second=second)
        except Retryable as error:
            if error.unreachable:
                raise  # no answer, so nothing to record
            answer = {"video_id": item.key, "outcome": "failed", "reason": error.reason}
        finally:
            with self._lock:
                self._idle.append(fetcher)
        outcome = answer["outcome"]
        yield Answer(
            kind,
            "transcript",
            {"video_id": item.key, "language": self._profile.language},
            answer,
            failed=str(answer["reason"]) if outcome == "failed" else None,
            complete=outcome == "ok",
        )
        asked = "second_tracks_asked" if second else "transcripts_asked"
        self._count(**{kind: int(outcome == "ok"), asked: int(outcome != "failed")})


def _never_final(call: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The answer. Only a list can be gone: a search or a pack of videos that is refused fails."""
    try:
        return call()
    except ItemFinal as fact:
        raise Retryable(fact.reason) from fact


def _page(item: Item) -> dict[str, str]:
    return {} if item.payload.token is None else {"pageToken": item.payload.token}
