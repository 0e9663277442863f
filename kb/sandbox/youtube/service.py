"""Serves the sandbox's YouTube: the Data API under /youtube/v3 with key and quota, and the site.

Units are counted a Pacific day and bucket in `world.used`, up to `world.quota`. A request that
fails for its key or for a spent bucket costs nothing; every other one costs a unit, 404 included.
"""

import base64
import binascii
import hashlib
import html
import json
import threading
from functools import partial
from typing import Any

from werkzeug.wrappers import Request, Response

from kb.sandbox.json_templates import written
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import Channel, Playlist, Video
from kb.sandbox.youtube.web import YouTubeWeb

KEY = "sandbox-youtube-key-that-opens-nothing"
MOST_HITS = 500
PARTS = {
    "search": {"snippet", "id"},
    "playlists": {"snippet", "contentDetails", "status", "id"},
    "playlistItems": {"snippet", "contentDetails", "status", "id"},
    "videos": {"snippet", "contentDetails", "status", "statistics", "player", "id"},
    "videos:batchGetStats": {"snippet", "contentDetails", "statistics", "id"},
}


def settings(url: str) -> dict[str, str]:
    """The settings that point at this YouTube."""
    return {"YOUTUBE_API_KEY": KEY, "KB_YOUTUBE_ENDPOINT": url, "KB_YOUTUBE_WEB": url}


def app(world: World) -> Any:
    """The WSGI application."""
    api, web = DataApi(world), YouTubeWeb(world)

    def serve(environ: dict[str, Any], start_response: Any) -> Any:
        request = Request(environ)
        response = (
            api.answer(request) if request.path.startswith("/youtube/v3/") else web.answer(request)
        )
        return response(environ, start_response)

    return serve


class ApiRefusal(Exception):
    """An error answer."""

    def __init__(self, name: str, value: object = "") -> None:
        self.answer = refusal(name, value)


class DataApi:
    """The Data API over a world."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._lock = threading.Lock()

    def answer(self, request: Request) -> Response:
        """One call."""
        method = request.path.removeprefix("/youtube/v3/")
        try:
            if method not in PARTS:
                raise ApiRefusal("not_found", request.path)
            self._spend(
                request,
                {"search": "search", "videos:batchGetStats": "stats"}.get(method, "general"),
            )
            parts = self._parts(request, PARTS[method])
            status, body = 200, getattr(self, "_" + method.replace(":", "_"))(request, parts)
        except ApiRefusal as refused:
            status, body = refused.answer
        # Escaped as ASCII, so that NUL and lone surrogates travel as JSON allows.
        return Response(
            json.dumps(body, indent=2),
            status,
            {"Vary": "Origin"},
            content_type="application/json; charset=UTF-8",
        )

    def _spend(self, request: Request, bucket: str) -> None:
        given = request.args.get("key") or request.headers.get("X-Goog-Api-Key")
        if not given:
            raise ApiRefusal("key_missing")
        if given != KEY:
            raise ApiRefusal("key_invalid")
        with self._lock:
            day = self.world.pacific_day()
            if self.world.used[day, bucket] >= self.world.quota[bucket]:
                name = "search_spent" if bucket == "search" else "general_spent"
                raise ApiRefusal(name, self.world.quota[bucket])
            self.world.used[day, bucket] += 1
        request.environ |= {"sandbox.units": 1, "sandbox.bucket": bucket}

    def _parts(self, request: Request, known: set[str]) -> set[str]:
        parts = set(_list(request, "part"))
        for part in sorted(parts - known):
            raise ApiRefusal("bad_part", part)
        if not parts:
            raise ApiRefusal("no_filter")
        return parts

    def _search(self, request: Request, parts: set[str]) -> dict[str, Any]:
        type_, query = request.args.get("type", "channel"), request.args.get("q", "")
        hits: list[dict[str, Any]] = []
        if type_ == "channel":
            hits = list(map(search_hit, self.world.youtube.search(query)))
        elif type_ == "playlist":
            hits = list(map(playlist_hit, self.world.youtube.search_playlists(query)))
        results, tokens, size = _paged(request, hits[:MOST_HITS])
        if "snippet" not in parts:
            for hit in results:
                del hit["snippet"]
        total = max(len(hits), 1_000_000 * bool(hits))
        return {**list_response("search", results, total, size, **tokens), "regionCode": "US"}

    def _playlistItems(self, request: Request, parts: set[str]) -> dict[str, Any]:
        playlist = request.args.get("playlistId", "")
        if not playlist:
            raise ApiRefusal("no_filter")
        if playlist not in self.world.youtube.by_playlist:
            private = (one.id for one in self.world.youtube.playlists if one.privacy == "private")
            raise ApiRefusal("private_playlist" if playlist in private else "no_playlist")
        entries = list(enumerate(self.world.youtube.by_playlist[playlist][1]))
        page, tokens, size = _paged(request, entries)
        items = []
        for position, video in page:
            key = base64.b64encode(f"{playlist}.{position}".encode()).decode()
            values = {**_of(video), "playlist": playlist, "position": position}
            # What is no longer public says so and has lost all else.
            entry = dict(_resource("entry" if video.in_api else "entry_private", values))
            items.append(_item("playlistItem", key, entry, parts))
        return list_response("playlistItem", items, len(entries), size, **tokens)

    def _playlists(self, request: Request, parts: set[str]) -> dict[str, Any]:
        asked = _ids(request)
        listed = [one for one in self.world.youtube.playlists if one.id in asked]
        shown = [one for one in listed if one.privacy in ("public", "unlisted")]
        items = [_item("playlist", one.id, playlist_parts(one), parts) for one in shown]
        return list_response("playlist", items, len(items), len(items))

    def _videos(self, request: Request, parts: set[str]) -> dict[str, Any]:
        frame = (request.args.get("maxWidth", type=int), request.args.get("maxHeight", type=int))
        videos = self._requested_videos(request)
        items = [_item("video", video.id, video_parts(video, *frame), parts) for video in videos]
        return list_response("video", items, len(videos), len(videos))

    def _videos_batchGetStats(self, request: Request, parts: set[str]) -> dict[str, Any]:
        items = []
        for video in self._requested_videos(request):
            full = video_parts(video, None, None)
            shown = {
                "snippet": {"publishTime": video.published_at},
                "contentDetails": {"duration": full["contentDetails"].get("duration")},
                "statistics": {
                    name: full["statistics"][name]
                    for name in ("viewCount", "likeCount", "commentCount")
                    if name in full["statistics"]
                },
            }
            items.append(_item("videoStats", video.id, shown, parts))
        return {
            "kind": "youtube#batchGetStatsResponse",
            "etag": etag("stats", len(items)),
            "items": items,
        }

    def _requested_videos(self, request: Request) -> list[Any]:
        videos = map(self.world.youtube.video_of, dict.fromkeys(_ids(request)))
        return [video for video in videos if video is not None and video.in_api]


def _list(request: Request, name: str) -> list[str]:
    return [
        part.strip()
        for value in request.args.getlist(name)
        for part in value.split(",")
        if part.strip()
    ]


def _ids(request: Request) -> list[str]:
    ids = _list(request, "id")
    if not ids:
        raise ApiRefusal("no_filter")
    if len(ids) > 50:
        raise ApiRefusal("too_many_ids")
    return ids


def _paged(request: Request, all_items: list[Any]) -> tuple[list[Any], dict[str, str], int]:
    """(items of the page, its tokens, its size). Tokens are opaque and hold the offset."""
    given = request.args.get("maxResults", "5")
    if not given.isdigit() or int(given) > 50:
        raise ApiRefusal("bad_size", given)
    size, start = int(given), 0
    if token := request.args.get("pageToken"):
        try:
            start = int(base64.urlsafe_b64decode(token.encode()).decode().removeprefix("at:"))
        except (ValueError, binascii.Error):
            raise ApiRefusal("bad_page_token") from None
    tokens = {}
    if start + size < len(all_items):
        tokens["nextPageToken"] = base64.urlsafe_b64encode(b"at:%06d" % (start + size)).decode()
    if start:
        tokens["prevPageToken"] = base64.urlsafe_b64encode(
            b"at:%06d" % max(0, start - size)
        ).decode()
    return all_items[start : start + size], tokens, size


def _item(kind: str, key: str, by_part: dict[str, Any], parts: set[str]) -> dict[str, Any]:
    head = {"kind": f"youtube#{kind}", "etag": etag(kind, key), "id": key}
    return head | {name: value for name, value in by_part.items() if name in parts}


_resource = partial(written, "youtube/resources.json")


def etag(*parts: object) -> str:
    """A made-up etag, the same for the same parts."""
    return hashlib.sha256(
        "\x1f".join(map(str, parts)).encode("utf-8", "surrogatepass")
    ).hexdigest()[:27]


def list_response(
    kind: str, items: list[Any], total: int, size: int, **tokens: str
) -> dict[str, Any]:
    """A list answer around `items`; `tokens` are nextPageToken and prevPageToken."""
    values = {
        "kind": kind,
        "etag": etag(kind, total, *tokens.values()),
        "next": tokens.get("nextPageToken"),
        "previous": tokens.get("prevPageToken"),
        "total": total,
        "size": size,
        "items": items,
    }
    return dict(_resource("page", values))


def search_hit(channel: Channel) -> dict[str, Any]:
    """A search result of type channel; titles are HTML-escaped here and nowhere else."""
    values = {
        "etag": etag("hit", channel.id),
        "id": channel.id,
        "published_at": channel.published_at,
        "title": html.escape(channel.title),
        "description": html.escape(channel.description[:160]),
    }
    return dict(_resource("search_hit", values))


def playlist_hit(playlist: Playlist) -> dict[str, Any]:
    """A search result of type playlist."""
    values = _of_list(playlist) | {"title": html.escape(playlist.title)}
    return dict(_resource("playlist_hit", values | {"etag": etag("hit", playlist.id)}))


def playlist_parts(playlist: Playlist) -> dict[str, Any]:
    """A playlist by part."""
    return dict(_resource("playlist", _of_list(playlist)))


def _of_list(playlist: Playlist) -> dict[str, Any]:
    return {
        "id": playlist.id,
        "title": playlist.title,
        "channel_id": playlist.channel.id,
        "channel_title": playlist.channel.title,
        "published_at": playlist.channel.published_at,
        "privacy": playlist.privacy,
        "count": len(playlist.entries),
    }


def video_parts(video: Video, max_width: int | None, max_height: int | None) -> dict[str, Any]:
    """A video by part; hidden counts are absent."""
    values = {
        **_of(video),
        "tags": video.tags or None,
        "category_id": video.category_id,
        "live": video.live,
        "language": _spoken(video),
        "duration": video.iso_duration,
        "definition": "hd" if min(video.width, video.height) >= 720 else "sd",
        "caption": str(any(track.kind != "asr" for track in video.tracks)).lower(),
        "licensed": video.number % 3 == 0,
        "rating": {"ytRating": video.rating} if video.rating else {},
        "license": video.license,
        "privacy": video.privacy,
        "view_count": video.view_count,
        "like_count": video.like_count,
        "comment_count": video.comment_count,
        "embed_width": None,
        "embed_height": None,
    }
    if video.sized and (max_width or max_height):
        # The largest frame of the video's own shape that fits.
        scale = min((max_width or 10**9) / video.width, (max_height or 10**9) / video.height)
        values["embed_width"] = str(round(video.width * scale))
        values["embed_height"] = str(round(video.height * scale))
    return dict(_resource("video", values))


def _spoken(video: Video) -> str:
    """What recognition heard is what is spoken."""
    heard = [track.language for track in video.tracks if track.kind == "asr"]
    return next(iter([*heard, *(track.language for track in video.tracks)]), "en")


def _of(video: Video) -> dict[str, Any]:
    return {
        "id": video.id,
        "title": video.title,
        "description": video.description,
        "published_at": video.published_at,
        "channel_id": video.channel.id,
        "channel_title": video.channel.title,
        "thumbnails": _thumbnails(video),
    }


def _thumbnails(video: Video) -> dict[str, Any]:
    thumbnails = dict(_resource("thumbnails", {"id": video.id}))
    if video.number % 4 == 0:
        del thumbnails["maxres"]  # not every video has one
    return thumbnails


Answer = tuple[int, dict[str, Any]]


def refusal(name: str, value: object = "") -> Answer:
    """A recorded error answer by its name in errors.json, with `value` in its text."""
    answer = written("youtube/errors.json", name, {"value": str(value)})
    return answer["status"], answer["response"]
