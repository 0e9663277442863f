"""Serves the sandbox's Reddit: token, listings, posts, morechildren, info and permalinks.

Both hosts (www and oauth) are one root here. Forms and limits are those of the recorded answers.
"""

import base64
import html
import json
import re
import threading
from html import escape
from pathlib import Path
from time import monotonic
from typing import Any

import zstandard
from werkzeug.wrappers import Request, Response

from kb.sandbox.invented_ids import ELSEWHERE, OTHER_SUBREDDIT, PEOPLE
from kb.sandbox.reddit.subreddit import START, Subreddit
from kb.sandbox.world import World

CLIENT, SECRET, TOKEN = "sandbox-reddit-app", "sandbox-reddit-secret", "sandbox-reddit-token"
WINDOW_S = 600
LISTED, PAGE, TREE, DEEPEST, BATCH = 1_000, 100, 500, 10, 100


def settings(url: str) -> dict[str, str]:
    """The settings that point at this Reddit."""
    return {"REDDIT_CLIENT_ID": CLIENT, "REDDIT_CLIENT_SECRET": SECRET, "KB_REDDIT_ENDPOINT": url}


def app(world: World) -> Any:
    """The WSGI application."""
    service = RedditService(world.reddit)

    def serve(environ: dict[str, Any], start_response: Any) -> Any:
        return service.answer(Request(environ))(environ, start_response)

    return serve


class RedditService:
    """Reddit's API over an invented subreddit."""

    def __init__(self, subreddit: Subreddit) -> None:
        self.subreddit = subreddit
        self._lock = threading.Lock()
        self._window, self._used = monotonic(), 0

    def answer(self, request: Request) -> Response:
        """One request."""
        path = request.path.strip("/").removesuffix(".json")
        if path == "api/v1/access_token":
            return self._token(request)
        if page := permalink(self.subreddit, path):
            return page
        if request.headers.get("Authorization") != f"bearer {TOKEN}":
            return _json(
                {"message": "Unauthorized", "error": 401},
                401,
                {"WWW-Authenticate": 'Bearer realm="reddit", error="invalid_token"'},
            )
        room = self._room()
        if room["x-ratelimit-remaining"] == "0.0" and self._used > self.subreddit.room:
            return _json(
                {"message": "Too Many Requests", "error": 429},
                429,
                {**room, "Retry-After": room["x-ratelimit-reset"]},
            )
        request.environ |= {"sandbox.units": 1, "sandbox.bucket": "requests"}
        parts = path.split("/")
        if parts[0] == "r" and len(parts) == 3 and parts[2] == "about":
            return self._about(parts[1], room)
        if parts[0] == "r" and len(parts) == 3:
            return self._listing(request, parts[1], parts[2], room)
        if parts[0] == "comments":
            return self._page(request, parts[1], parts[3] if len(parts) > 3 else None, room)
        if path == "api/info":
            return self._info(request, room)
        if path == "api/morechildren":
            return self._more(request, room)
        return _json({"message": "Not Found", "error": 404}, 404, room)

    def _token(self, request: Request) -> Response:
        given = request.headers.get("Authorization", "").removeprefix("Basic ")
        if given != base64.b64encode(f"{CLIENT}:{SECRET}".encode()).decode():
            return _json({"message": "Unauthorized", "error": 401}, 401)
        return _json(
            {"access_token": TOKEN, "token_type": "bearer", "expires_in": 86_400, "scope": "*"}
        )

    def _room(self) -> dict[str, str]:
        with self._lock:
            if monotonic() - self._window > WINDOW_S:
                self._window, self._used = monotonic(), 0
            self._used += 1
            left = max(0, self.subreddit.room - self._used)
            return {
                "x-ratelimit-used": str(self._used),
                "x-ratelimit-remaining": f"{left}.0",
                "x-ratelimit-reset": str(int(WINDOW_S - (monotonic() - self._window))),
            }

    def _about(self, name: str, room: dict[str, str]) -> Response:
        """The subreddit's own page; of one that is not there Reddit leads to its search."""
        if name.lower() != self.subreddit.name.lower():
            return _json(b"", 302, {**room, "Location": f"/subreddits/search?q={name}"})
        about = {
            "id": "z300000000sub",
            "display_name": self.subreddit.name,
            "display_name_prefixed": f"r/{self.subreddit.name}",
            "title": self.subreddit.name,
            "subreddit_type": "public",
            "subscribers": 8_000,
            "over18": False,
            "lang": "en",
        }
        return _json({"kind": "t5", "data": about}, 200, room)

    def _listing(self, request: Request, name: str, listing: str, room: dict[str, str]) -> Response:
        if name.lower() != self.subreddit.name.lower():
            return _json(b"", 302, {**room, "Location": f"/subreddits/search?q={name}"})
        posts = list(self.subreddit.posts.values())[::-1]
        if listing in ("top", "controversial"):
            posts = sorted(posts, key=lambda post: -post.get("score", 0))
        elif listing in ("hot", "rising"):
            posts = posts[: 60 if listing == "hot" else 25]
        elif listing == "search":
            words = request.args.get("q", "").lower().split()
            posts = [
                post
                for post in posts
                if any(word in f"{post['title']} {post['selftext']}".lower() for word in words)
            ]
        elif listing != "new":
            return _json({"message": "Not Found", "error": 404}, 404, room)
        names = [post["name"] for post in posts if post["name"] not in self.subreddit.gone][:LISTED]
        after = request.args.get("after")
        start = names.index(after) + 1 if after in names else 0
        shown = names[start : start + min(PAGE, request.args.get("limit", 25, int))]
        more = shown[-1] if shown and start + len(shown) < len(names) else None
        return _json(
            _list([{"kind": "t3", "data": self.subreddit.shown(key)} for key in shown], more),
            200,
            room,
        )

    def _page(
        self, request: Request, post: str, comment: str | None, room: dict[str, str]
    ) -> Response:
        about = self.subreddit.shown(f"t3_{post}")
        if about is None:
            return _json({"message": "Not Found", "error": 404}, 404, room)
        left = [min(TREE, request.args.get("limit", TREE, int))]
        tops = [comment] if comment else self.subreddit.replies.get(f"t3_{post}", [])
        base = self.subreddit.comments[comment]["depth"] if comment else 0
        shown = self._below(tops, f"t3_{post}", base, left)
        return _json([_list([{"kind": "t3", "data": about}]), _list(shown)], 200, room)

    def _below(
        self, keys: list[str], parent: str, base: int, left: list[int]
    ) -> list[dict[str, Any]]:
        """Replies as nested things, with stubs for what does not fit."""
        things: list[dict[str, Any]] = []
        for place, key in enumerate(keys):
            if left[0] <= 0:
                things.append(self._stub(keys[place:], parent))
                break
            data = self.subreddit.shown(f"t1_{key}")
            if data is None:
                continue
            left[0] -= 1
            replies = self.subreddit.replies.get(f"t1_{key}", [])
            inner: list[dict[str, Any]] = []
            if replies and data["depth"] - base >= DEEPEST - 1:
                inner = [
                    {
                        "kind": "more",
                        "data": {
                            "count": 0,
                            "name": "t1__",
                            "id": "_",
                            "parent_id": f"t1_{key}",
                            "depth": data["depth"] + 1,
                            "children": [],
                        },
                    }
                ]
            elif replies:
                inner = self._below(replies, f"t1_{key}", base, left)
            things.append(
                {"kind": "t1", "data": {**data, "replies": _list(inner) if inner else ""}}
            )
        return things

    def _stub(self, keys: list[str], parent: str) -> dict[str, Any]:
        return {
            "kind": "more",
            "data": {
                "count": len(keys),
                "name": f"t1_{keys[0]}",
                "id": keys[0],
                "parent_id": parent,
                "depth": 0,
                "children": keys,
            },
        }

    def _more(self, request: Request, room: dict[str, str]) -> Response:
        keys = [key for key in request.values.get("children", "").split(",") if key]
        if len(keys) > BATCH:
            return _json({"message": "Bad Request", "error": 400}, 400, room)
        things: list[dict[str, Any]] = []
        for key in keys:
            data = self.subreddit.shown(f"t1_{key}")
            if data is None:
                continue
            things.append({"kind": "t1", "data": data})
            replies = self.subreddit.replies.get(f"t1_{key}", [])
            if replies:
                things.append(self._stub(replies, f"t1_{key}"))
        return _json({"json": {"errors": [], "data": {"things": things}}}, 200, room)

    def _info(self, request: Request, room: dict[str, str]) -> Response:
        names = [name for name in request.args.get("id", "").split(",") if name][:BATCH]
        things = [(name, self.subreddit.shown(name)) for name in names]
        return _json(
            _list([{"kind": name[:2], "data": data} for name, data in things if data is not None]),
            200,
            room,
        )


def _escaped(thing: dict[str, Any]) -> dict[str, Any]:
    """A post or comment as Reddit gives it without raw_json=1."""
    texts = {name: thing[name] for name in ("title", "selftext", "body", "url") if name in thing}
    return {**thing, **{name: html.escape(text, quote=False) for name, text in texts.items()}}


def dumps(subreddit: Subreddit, folder: Path) -> list[Path]:
    """A pair of archive dumps of the same subreddit a year earlier, in the old fields,
    with two bad lines; their paths.
    """
    other = {
        "id": ELSEWHERE,
        "subreddit": OTHER_SUBREDDIT,
        "author": PEOPLE[-1],
        "title": "A fern",
        "created_utc": START,
        "score": 9,
    }
    posts, comments = (
        [json.dumps(other)],
        [json.dumps({**other, "body": "nice", "link_id": f"t3_{ELSEWHERE}"})],
    )
    old_posts, old_comments = subreddit.archive
    for number, post in enumerate(old_posts.values()):
        made = int(post["created_utc"])
        old = {**_escaped(post), "created_utc": str(made), "retrieved_on": made + 500_000}
        for name in ("upvote_ratio", "is_robot_indexable", "removed_by_category", "name"):
            old.pop(name, None)
        posts.append(json.dumps(old, separators=(",", ":") if number % 2 else None))
    for comment in old_comments.values():
        old = {
            **_escaped(comment),
            "created_utc": int(comment["created_utc"]),
            "retrieved_on": int(comment["created_utc"]) + 500_000,
        }
        del old["depth"], old["replies"], old["name"]
        comments.append(json.dumps(old))
    posts.insert(7, f'{{"id": "broken", "subreddit": "{subreddit.name}", "title": "cut')
    comments.insert(5, f"not json at all, about {subreddit.name}")
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / "RS_2022-11.zst", folder / "RC_2022-11.zst"]
    for path, lines in zip(paths, (posts, comments), strict=True):
        half = len(lines) // 2
        frames = ("\n".join(part) + "\n" for part in (lines[:half], lines[half:]))
        path.write_bytes(
            b"".join(zstandard.ZstdCompressor(level=3).compress(frame.encode()) for frame in frames)
        )
    return paths


def _list(children: list[dict[str, Any]], after: str | None = None) -> dict[str, Any]:
    return {
        "kind": "Listing",
        "data": {
            "after": after,
            "dist": len(children),
            "modhash": "",
            "geo_filter": "",
            "children": children,
            "before": None,
        },
    }


def _json(body: Any, status: int = 200, headers: dict[str, str] | None = None) -> Response:
    data = body if isinstance(body, bytes) else json.dumps(body)
    return Response(data, status, headers or {}, content_type="application/json; charset=UTF-8")


_PERMALINK = re.compile(r"r/(\w+)/comments/(\w+)(?:/([^/]*)(?:/(\w+))?)?")


def permalink(subreddit: Subreddit, path: str) -> Response | None:
    """The page under a permalink; None for another path, and 404 for what is not there."""
    match = _PERMALINK.fullmatch(path)
    if match is None:
        return None
    name, post, _, comment = match.groups()
    above = subreddit.shown(f"t3_{post}")
    below = subreddit.shown(f"t1_{comment}") if comment else None
    elsewhere = below is not None and below["link_id"] != f"t3_{post}"
    lost = above is None or (comment and below is None) or elsewhere
    if above is None or lost or name.lower() != subreddit.name.lower():
        return Response("<!DOCTYPE html><title>page not found</title>", 404, mimetype="text/html")
    text = f"<h1>{escape(above['title'])}</h1>\n<p>{escape(above['selftext'])}</p>"
    parts = [f'<article id="t3_{post}">{text}</article>']
    if below is not None:
        parts.append(f'<article id="t1_{comment}"><p>{escape(below["body"])}</p></article>')
    page = "\n".join(["<!DOCTYPE html>", f"<title>{escape(above['title'])}</title>", *parts])
    return Response(page.encode("utf-8", "replace"), mimetype="text/html")
