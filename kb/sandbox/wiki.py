"""The sandbox's wiki: recorded pages and pictures, and the part of `api.php` that a crawl asks.

`app(world, faults)` serves the state `world.wiki_state`, "first" (the default) or "later": after
some edits, a deletion, a move and a new page.
"""

from __future__ import annotations

import json
import mimetypes
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from werkzeug.security import safe_join
from werkzeug.utils import redirect
from werkzeug.wrappers import Request, Response

DATA = Path(__file__).with_name("data") / "wiki"
HOST = "http://wiki.example"
# Moved away and deleted in the later state: what the old addresses show then.
_LATER = {"Lamp buoy": "lamp-float", "Charts": None}


def settings(url: str) -> dict[str, str]:
    """The settings that point at this wiki."""
    return {"KB_WIKI_URL": url, "KB_CONTACT": "sandbox@lorebase.invalid"}


def app(world: Any = None, faults: Any = None) -> Any:
    """The WSGI application."""
    return (
        faults.wrap("wiki", _application(world)) if hasattr(faults, "wrap") else _application(world)
    )


def _application(world: Any) -> Any:
    @Request.application
    def serve(request: Request) -> Response:
        later = getattr(world, "wiki_state", "first") == "later"
        root = request.host_url.rstrip("/")
        path = request.path
        if path == "/":
            return redirect(f"{root}/wiki/Main_Page", 301)
        if path in ("/w/api.php", "/api.php"):
            return _api({**request.args.to_dict(), **request.form.to_dict()}, later, root)
        if path.startswith("/wiki/"):
            return _page(path.removeprefix("/wiki/").replace("_", " "), later, root)
        return _file(path)

    return serve


def _page(title: str, later: bool, root: str) -> Response:
    title = title.replace(
        "Rock salt", "Saltstone"
    )  # MediaWiki shows a redirect's target under its own address
    stem = _slugs().get(title)
    if later:
        stem = _LATER.get(title, stem)
    elif title in ("New jetty", "Lamp float"):
        stem = None
    for folder in ([DATA / "html" / "later"] if later else []) + [DATA / "html"]:
        file = folder / f"{stem}.html"
        if stem and file.is_file():
            return Response(
                file.read_text(encoding="utf-8").replace(HOST, root), mimetype="text/html"
            )
    return Response(
        f"<!DOCTYPE html><title>{title.replace('<', '')}</title><p>There is no such page.</p>",
        404,
        mimetype="text/html",
    )


def _file(path: str) -> Response:
    found = safe_join(str(DATA), path.lstrip("/"))
    if (
        not path.startswith(("/images/", "/static/", "/robots.txt"))
        or not found
        or not Path(found).is_file()
    ):
        return Response("not found", 404, mimetype="text/plain")
    return Response(
        Path(found).read_bytes(),
        mimetype=mimetypes.guess_type(path)[0] or "application/octet-stream",
    )


def _load(name: str) -> Any:
    return json.loads((DATA / "api" / name).read_text(encoding="utf-8"))


@cache
def _slugs() -> dict[str, str]:
    """Title to file stem; the file's own RLCONF has the title."""
    found = {}
    for file in sorted((DATA / "html").rglob("*.html")):
        conf = (
            file.read_text(encoding="utf-8")
            .split("window.RLCONF = ", 1)[1]
            .split(";</script>", 1)[0]
        )
        found[json.loads(conf)["wgTitle"]] = file.stem
    return found


@cache
def _pages(later: bool) -> dict[str, dict[str, Any]]:
    """The pages of a state by title, redirects too."""
    pages = [
        page
        for page in _load("later/pages.json" if later else "pages.json")["query"]["pages"]
        if not page.get("missing")
    ]
    if later:
        known = {page["title"] for page in pages}
        for part in (1, 2, 3):
            for page in _load(f"later/generator-{part}.json")["query"]["pages"]:
                if page["title"] not in known:
                    pages.append({**page, "contributors": [{"userid": 3, "name": "Maren Holt"}]})
    pages.append(
        {
            "pageid": 27,
            "ns": 0,
            "title": "Rock salt",
            "redirect": True,
            "lastrevid": 30,
            "length": 23,
            "fullurl": f"{HOST}/wiki/Rock_salt",
            "canonicalurl": f"{HOST}/wiki/Rock_salt",
            "revisions": [{"revid": 30, "parentid": 0, "timestamp": "2024-01-11T10:10:00Z"}],
        }
    )
    return {page["title"]: page for page in pages}


def _api(query: dict[str, str], later: bool, root: str) -> Response:
    if query.get("action") == "rsd":
        return Response(
            (DATA / "api" / "rsd.xml").read_text().replace(HOST, root),
            mimetype="application/rsd+xml",
        )
    if query.get("action") != "query":
        return _json(
            {
                "error": {
                    "code": "badvalue",
                    "info": f'Unrecognized value for parameter "action": {query.get("action")}.',
                }
            },
            root,
            {"MediaWiki-API-Error": "badvalue"},
        )
    if int(query.get("maxlag", 5)) < -1:
        return _json(
            {
                "error": {
                    "code": "maxlag",
                    "info": "Waiting for a database server.",
                    "lag": -1,
                    "type": "db",
                }
            },
            root,
            {"Retry-After": "5", "MediaWiki-API-Error": "maxlag"},
        )
    answer: dict[str, Any] = {"batchcomplete": True, "query": {}}
    if query.get("meta") == "siteinfo":
        answer["query"] |= _load("siteinfo.json")["query"]
    if query.get("list") == "allpages":
        _allpages(query, later, answer)
    if query.get("titles") or query.get("pageids") or query.get("revids"):
        _details(query, later, answer)
    return _json(answer, root)


def _allpages(query: dict[str, str], later: bool, answer: dict[str, Any]) -> None:
    filter_ = query.get("apfilterredir", "all")
    pages = [
        page
        for page in _pages(later).values()
        if str(page["ns"]) == query.get("apnamespace", "0")
        and (filter_ == "all" or bool(page.get("redirect")) == (filter_ == "redirects"))
    ]
    pages.sort(key=lambda page: page["title"])
    pages = [
        page for page in pages if page["title"].replace(" ", "_") >= query.get("apcontinue", "")
    ]
    limit = min(500, int(query.get("aplimit", 10)))
    answer["query"]["allpages"] = [
        {key: page[key] for key in ("pageid", "ns", "title")} for page in pages[:limit]
    ]
    if len(pages) > limit:
        answer["continue"] = {
            "apcontinue": pages[limit]["title"].replace(" ", "_"),
            "continue": "-||",
        }
        del answer["batchcomplete"]


def _details(query: dict[str, str], later: bool, answer: dict[str, Any]) -> None:
    pages = _pages(later)
    by_id = {str(page["pageid"]): page for page in pages.values()}
    by_revision = {str(page["lastrevid"]): page for page in pages.values()}
    files = {page["title"]: page for page in _load("imageinfo.json")["query"]["pages"]}
    found: list[dict[str, Any]] = []
    normalized = []
    for wanted in (query.get("titles", "").split("|") if query.get("titles") else [])[:50]:
        title = wanted.replace("_", " ").strip()
        title = title[:1].upper() + title[1:]
        if title.startswith("File:"):
            title = "File:" + title[5:6].upper() + title[6:]
        if title != wanted:
            normalized.append({"fromencoded": False, "from": wanted, "to": title})
        held = pages.get(title) or files.get(title)
        if any(char in title for char in "[]{}<>#"):
            found.append(
                {
                    "title": title,
                    "invalid": True,
                    "invalidreason": "The requested page title contains invalid characters.",
                }
            )
        else:
            found.append(
                held
                or {"ns": 6 if title.startswith("File:") else 0, "title": title, "missing": True}
            )
    found += [
        by_id.get(key) or {"pageid": int(key), "missing": True}
        for key in query.get("pageids", "").split("|")
        if key
    ]
    found += [by_revision[key] for key in query.get("revids", "").split("|") if key in by_revision]
    if normalized:
        answer["query"]["normalized"] = normalized
    answer["query"]["pages"] = found


def _json(answer: dict[str, Any], root: str, headers: dict[str, str] | None = None) -> Response:
    text = json.dumps(answer, ensure_ascii=False).replace(HOST, root)
    return Response(text, mimetype="application/json", headers=headers)


def address(root: str, title: str) -> str:
    """Where a page of that title is."""
    return f"{root}/wiki/{quote(title.replace(' ', '_'), safe=chr(39) + '()!*,;:@/')}"


__all__ = ["address", "app", "settings"]
