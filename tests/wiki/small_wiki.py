"""A small MediaWiki for tests of odd answers: pages by id, a robots.txt, and a hook that may answer
instead.
"""

import json
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from werkzeug.wrappers import Request, Response

WORDS = "word " * 30


class SmallWiki:
    """`add` pages; `asked` has the path of every request; `hook(request)` may return a Response, or
    JSON to be one.
    """

    def __init__(self) -> None:
        self.pages: dict[int, dict[str, Any]] = {}
        self.asked: list[str] = []
        self.robots = ""
        self.hook: Callable[[Request], Any] = lambda request: None

    def add(
        self, key: int, title: str, html: str = f"<p>{WORDS}</p>", revision: int = 0, **more: Any
    ) -> None:
        self.pages[key] = {"title": title, "html": html, "revid": revision or key * 10, **more}

    def shown(self) -> list[str]:
        """Titles of the pages that were shown since the last call."""
        found, self.asked = (
            [path.removeprefix("/wiki/") for path in self.asked if path.startswith("/wiki/")],
            [],
        )
        return found

    def _by_title(self, title: str) -> tuple[int, dict[str, Any]] | None:
        wanted = title.replace("_", " ")
        return next(
            (
                (key, page)
                for key, page in self.pages.items()
                if page["title"] == wanted[:1].upper() + wanted[1:]
            ),
            None,
        )

    @Request.application
    def application(self, request: Request) -> Response:
        self.asked.append(request.path)
        answer = self.hook(request)
        if answer is not None:
            return (
                answer
                if isinstance(answer, Response)
                else Response(json.dumps(answer), content_type="application/json")
            )
        if request.path == "/robots.txt":
            return Response(self.robots)
        if request.path == "/w/api.php":
            return Response(json.dumps(self.api(request)), content_type="application/json")
        if request.path.startswith("/wiki/"):
            return self._page(request.path.removeprefix("/wiki/"))
        if request.path == "/":
            conf = '<script>RLCONF={"wgArticleId":0,"wgRevisionId":0};</script>'
            link = '<link rel="EditURI" href="/w/api.php?action=rsd">'
            return Response(f"<!DOCTYPE html>{conf}{link}</html>", content_type="text/html")
        return Response("nothing here", 404)

    def _page(self, title: str) -> Response:
        held = self._by_title(title)
        if held is None:
            return Response("no such page", 404)
        key, page = held
        conf = f'<script>RLCONF={{"wgArticleId":{key},"wgRevisionId":{page["revid"]}}};</script>'
        return Response(
            f"<!DOCTYPE html>{conf}<div id=content>{page['html']}</div></html>",
            content_type="text/html; charset=utf-8",
        )

    def api(self, request: Request) -> dict[str, Any]:
        query, root = request.args, request.host_url.rstrip("/")
        if query.get("meta"):
            return {
                "query": {
                    "general": {"server": root, "script": "/w/index.php"},
                    "namespaces": {"0": {"id": 0, "content": True}},
                }
            }
        if query.get("list"):
            listed = [
                {"pageid": key, "ns": 0, "title": page["title"]}
                for key, page in self.pages.items()
                if not page.get("redirect")
            ]
            return {"query": {"allpages": listed}}
        found: list[dict[str, Any]] = []
        normalized, interwiki = [], []
        for title in query.get("titles", "").split("|") if "titles" in query else ():
            if title.startswith("wp:"):
                interwiki.append({"title": title, "iw": "wp"})
                continue
            written = title[:1].upper() + title[1:]
            normalized += (
                [{"fromencoded": False, "from": title, "to": written}] if written != title else []
            )
            if held := self._by_title(title):
                found.append(self._told(*held, root))
            else:
                found.append({"ns": 0, "title": written, "missing": True})
        for key in query.get("pageids", "").split("|") if "pageids" in query else ():
            found.append(
                self._told(int(key), self.pages[int(key)], root)
                if int(key) in self.pages
                else {"pageid": int(key), "missing": True}
            )
        parts = {"pages": found, "normalized": normalized, "interwiki": interwiki}
        return {
            "batchcomplete": True,
            "query": {name: part for name, part in parts.items() if part},
        }

    def _told(self, key: int, page: dict[str, Any], root: str) -> dict[str, Any]:
        revision = {"revid": page["revid"], "timestamp": "2024-01-01T00:00:00Z"}
        url = f"{root}/wiki/{quote(page['title'].replace(' ', '_'))}"
        return {
            "pageid": key,
            "ns": 0,
            "title": page["title"],
            "fullurl": url,
            "revisions": [revision],
        } | ({"redirect": True} if page.get("redirect") else {})
