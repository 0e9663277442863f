"""Raw answers about playlists → youtube/playlists and youtube/playlist_videos.

    search           finds playlists by a phrase: title and owner
    playlists        the same of playlists that a list named, or that were read again
    playlist_items   the entries of a playlist, page by page
    ytdlp_playlists  an imported file: title, owner and entries

The newest reading of a playlist that came to its end says what it lists, before one that was
stopped. A playlist that is gone, or not public, has no row, and neither has one without a kept
video.
"""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa

from kb.core import clock
from kb.schema.coerce import inner
from kb.schema.tables import table
from kb.schema.video_facts import NOT_PUBLIC
from kb.store.layout import parquet_files
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table
from kb.youtube.parse import answers as parse
from kb.youtube.parse.channels import is_uploads


class ListFacts(NamedTuple):
    """What an answer says of a playlist as a whole."""

    at: str
    title: str | None
    channel: str | None
    hidden: bool = False


@dataclass
class ListReading:
    """One reading of a playlist, page by page. `positions`: by video, its first place."""

    at: str
    count: int | None = None
    gone: bool = False
    hidden: bool = False
    read: int = 0
    positions: dict[str, int] = field(default_factory=dict)

    def add(self, entries: Sequence[tuple[str | None, int | None]]) -> None:
        """The next entries: the video of each, and its place where the entry names one."""
        for video, place in entries:
            if video is not None:
                self.positions.setdefault(video, self.read if place is None else place)
            self.read += 1


@dataclass
class Playlist:
    """What is known of a playlist. `phrases`: those that found it."""

    facts: ListFacts | None = None
    reading: ListReading | None = None  # the newest one that came to its end
    started: ListReading | None = None  # one that is under way
    phrases: set[str] = field(default_factory=set)

    def learn(self, facts: ListFacts) -> None:
        """Newer facts take the place of older ones."""
        if self.facts is None or facts.at >= self.facts.at:
            self.facts = facts

    def finish(self, reading: ListReading) -> None:
        """A newer reading takes the place of an older one."""
        if self.reading is None or reading.at >= self.reading.at:
            self.reading = reading

    @property
    def newest(self) -> ListReading | None:
        """The reading that counts."""
        return self.reading or self.started

    @property
    def left_out(self) -> str:
        """Why it has no row, "" for a public one with entries."""
        if self.newest is not None and self.newest.gone:
            return "not_found"
        if any(part is not None and part.hidden for part in (self.facts, self.newest)):
            return "not_public"
        if self.newest is None or self.facts is None:  # until then it may be unlisted
            return "not_read"
        return "" if self.newest.positions else "empty"


def playlists(root: Path) -> dict[str, Playlist]:
    """Every playlist that an answer tells of, by id. Raises DamagedData."""
    known: dict[str, Playlist] = {}
    for kind, take in _TAKES.items():
        for envelope in rawlog.envelopes(root, "youtube", kind):
            take(known, envelope)
    return known


def _take_search(known: dict[str, Playlist], envelope: Envelope) -> None:
    if envelope.request.params.get("type") != "playlist":
        return
    for item in parse.items_of(envelope.response):
        if isinstance(key := inner(item, "id", "playlistId"), str) and key:
            one = known.setdefault(key, Playlist())
            one.phrases.add(str(envelope.request.params.get("q")))
            one.learn(_facts_of(envelope, item, html.unescape))


def _take_facts(known: dict[str, Playlist], envelope: Envelope) -> None:
    for key in parse.missing(envelope.request.params, envelope.response):
        known.setdefault(key, Playlist()).finish(ListReading(envelope.fetched_at or "", gone=True))
    for item in parse.items_of(envelope.response):
        if isinstance(there := item.get("id"), str):
            known.setdefault(there, Playlist()).learn(_facts_of(envelope, item, str))


def _facts_of(envelope: Envelope, item: dict[str, Any], plain: Any) -> ListFacts:
    title, channel = (inner(item, "snippet", name) for name in ("title", "channelId"))
    hidden = inner(item, "status", "privacyStatus") in NOT_PUBLIC
    named = plain(title) if isinstance(title, str) else None
    return ListFacts(
        envelope.fetched_at or "", named, channel if isinstance(channel, str) else None, hidden
    )


def _take_items(known: dict[str, Playlist], envelope: Envelope) -> None:
    params, answer = envelope.request.params, envelope.response
    if is_uploads(key := str(params.get("playlistId", ""))):
        return
    one = known.setdefault(key, Playlist())
    if one.started is None or not params.get("pageToken"):
        one.started = ListReading(envelope.fetched_at or "")
    reading = one.started
    reading.at = envelope.fetched_at or ""
    reading.gone, reading.hidden = envelope.status == 404, envelope.status == 403
    if isinstance(count := inner(answer, "pageInfo", "totalResults"), int):
        reading.count = count
    entries = parse.items_of(answer)
    places = (inner(item, "snippet", "position") for item in entries)
    whole = (place if isinstance(place, int) else None for place in places)
    reading.add(list(zip(map(parse.listed_video, entries), whole, strict=True)))
    if parse.next_page(answer) is None:
        one.finish(reading)
        one.started = None


def _take_file(known: dict[str, Playlist], envelope: Envelope) -> None:
    answer: Any = envelope.response
    if (key := str(answer["id"])).startswith("UC") or is_uploads(key):
        return
    one, at = known.setdefault(key, Playlist()), envelope.fetched_at or ""
    hidden = answer.get("availability") in NOT_PUBLIC
    owners = (answer.get(name) for name in ("channel_id", "uploader_id"))
    owner = next((name for name in owners if str(name).startswith("UC")), None)  # no handle
    one.learn(ListFacts(at, answer.get("title"), owner, hidden))
    reading = ListReading(at, answer.get("playlist_count"))
    for entry in answer["entries"]:
        place = entry.get("playlist_index")
        reading.add([(str(entry["id"]), place - 1 if isinstance(place, int) and place else None)])
    one.finish(reading)


_TAKES = {
    "search": _take_search,
    "playlists": _take_facts,
    "playlist_items": _take_items,
    "ytdlp_playlists": _take_file,
}


class LastRead(NamedTuple):
    """When a playlist's title and owner were last read, and when its entries were (RFC 3339)."""

    facts: str | None
    entries: str | None


def last_read(root: Path) -> dict[str, LastRead]:
    """Of each playlist that the service has. Raises DamagedData."""
    return {
        key: LastRead(
            known.facts.at if known.facts is not None else None,
            known.newest.at if known.newest is not None else None,
        )
        for key, known in playlists(root).items()
        if known.left_out not in ("not_found", "not_public")
    }


class PlaylistTables:
    """Writes both tables beside the kept videos. `phrases`: of the profile, in its order;
    `left_out`: once they are written, the playlists without a row by reason.
    """

    def __init__(self, phrases: Sequence[str]) -> None:
        self._phrases = phrases
        self.left_out: dict[str, list[str]] = {}

    def __call__(self, root: Path, made: Path) -> dict[str, int]:
        """Both tables in the folder `made`; how many rows each has. Raises DamagedData,
        DiskFull.
        """
        kept = set[str]()
        for path in parquet_files(made / "videos"):
            ids = parquet.read_table(path, columns=["video_id"])["video_id"].to_pylist()
            kept.update(cast("list[str]", ids))
        rows: dict[str, list[dict[str, Any]]] = {"playlists": [], "playlist_videos": []}
        self.left_out = {}
        for key, one in sorted(playlists(root).items()):
            if one.left_out or one.newest is None:
                self.left_out.setdefault(one.left_out, []).append(key)
                continue
            places = one.newest.positions.items()
            listed = sorted((place, video) for video, place in places if video in kept)
            if listed:
                rows["playlists"].append(self._row(key, one, one.newest))
            rows["playlist_videos"] += (
                {"playlist_id": key, "video_id": video, "position": place}
                for place, video in listed
            )
        for short, of_table in rows.items():
            declared = table(f"youtube/{short}")
            made_rows = pa.Table.from_pylist(of_table, declared.arrow())
            (made / short).mkdir(exist_ok=True)
            write_table(made / short / "part-00000.parquet", made_rows, declared, sync=False)
        return {f"youtube/{short}": len(of_table) for short, of_table in rows.items()}

    def _row(self, key: str, one: Playlist, reading: ListReading) -> dict[str, Any]:
        known = (words for words in self._phrases if words in one.phrases)
        return {
            "playlist_id": key,
            "title": one.facts and one.facts.title,
            "channel_id": one.facts and one.facts.channel,
            "item_count": reading.count,
            "keyword": next(known, min(one.phrases, default=None)),
            "fetched_at": clock.parse(reading.at),
        }
