"""The sandbox's wiki: pages and pictures, and the part of `api.php` that a crawl asks. The pages
are recorded ones (kb/sandbox/wiki/recorded.py) and made for a domain
(kb/sandbox/wiki/generated.py).

`app(world, faults)` serves the state `world.wiki_state`, "first" (the default) or "later": after
some edits, a deletion, a move and a new page.
"""

from __future__ import annotations

import json
import mimetypes
from typing import Any

from werkzeug.utils import redirect
from werkzeug.wrappers import Request, Response

from kb.sandbox.wiki.generated import PAGES, Named
from kb.sandbox.wiki.recorded import DATA, HOST, Recorded


def settings(url: str) -> dict[str, str]:
    """The settings that point at this wiki."""
    return {"KB_WIKI_URL": url, "KB_CONTACT": "sandbox@lorecrawl.invalid"}


def app(world: Any = None, faults: Any = None) -> Any:
    """The WSGI application."""
    return (
        faults.wrap("wiki", _application(world)) if hasattr(faults, "wrap") else _application(world)
    )


def _application(world: Any) -> Any:
    domain = getattr(world, "domain", None)
    named = getattr(world, "n_named", None)
    if domain is None or (domain.recorded_wiki and not named):
        site = Recorded()
    else:
        site = Named(domain, PAGES if named is None else named)

    @Request.application
    def serve(request: Request) -> Response:
        later = getattr(world, "wiki_state", "first") == "later"
        root = request.host_url.rstrip("/")
        path = request.path
        if path == "/":
            return redirect(f"{root}/wiki/Main_Page", 301)
        if path in ("/w/api.php", "/api.php"):
            query = {**request.args.to_dict(), **request.form.to_dict()}
            return _api(query, site, later, root, getattr(world, "n_pages", None))
        if path.startswith("/wiki/"):
            title = path.removeprefix("/wiki/").replace("_", " ")
            return _page(site, title, later, root, request.args.get("oldid", ""))
        return _file(site, path)

    return serve


def _page(site: Recorded, title: str, later: bool, root: str, oldid: str = "") -> Response:
    """The page as it is now, or of the revision `oldid`."""
    text = site.html(title, later)
    if oldid:
        states = (state for state in (later, False) if _revision(site, title, state) == oldid)
        text = next((site.html(title, state) for state in states), None)
    if text is not None:
        return Response(text.replace(HOST, root), mimetype="text/html")
    return Response(
        f"<!DOCTYPE html><title>{title.replace('<', '')}</title><p>There is no such page.</p>",
        404,
        mimetype="text/html",
    )


def _revision(site: Recorded, title: str, later: bool) -> str:
    page = site.pages(later).get(title)
    return str(page["lastrevid"]) if page else ""


def _file(site: Recorded, path: str) -> Response:
    data = site.file(path)
    if data is None:
        return Response("not found", 404, mimetype="text/plain")
    return Response(data, mimetype=mimetypes.guess_type(path)[0] or "application/octet-stream")


def _api(
    query: dict[str, str], site: Recorded, later: bool, root: str, listed: int | None
) -> Response:
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
        answer["query"] |= site.load("siteinfo.json")["query"]
    if query.get("list") == "allpages":
        _allpages(query, site, later, answer, listed)
    if query.get("titles") or query.get("pageids") or query.get("revids"):
        _details(query, site, later, answer)
    return _json(answer, root)


def _allpages(
    query: dict[str, str], site: Recorded, later: bool, answer: dict[str, Any], listed: int | None
) -> None:
    filter_ = query.get("apfilterredir", "all")
    pages = [
        page
        for page in site.pages(later).values()
        if str(page["ns"]) == query.get("apnamespace", "0")
        and (filter_ == "all" or bool(page.get("redirect")) == (filter_ == "redirects"))
    ]
    pages.sort(key=lambda page: page["title"])
    after = query.get("apcontinue", "")
    pages = [page for page in pages[:listed] if page["title"].replace(" ", "_") >= after]
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


def _details(query: dict[str, str], site: Recorded, later: bool, answer: dict[str, Any]) -> None:
    pages = site.pages(later)
    by_id = {str(page["pageid"]): page for page in pages.values()}
    by_revision = {str(page["lastrevid"]): page for page in pages.values()}
    files = {page["title"]: page for page in site.load("imageinfo.json")["query"]["pages"]}
    shown: list[dict[str, Any]] = []
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
            shown.append(
                {
                    "title": title,
                    "invalid": True,
                    "invalidreason": "The requested page title contains invalid characters.",
                }
            )
        else:
            shown.append(
                held
                or {"ns": 6 if title.startswith("File:") else 0, "title": title, "missing": True}
            )
    shown += [
        by_id.get(key) or {"pageid": int(key), "missing": True}
        for key in query.get("pageids", "").split("|")
        if key
    ]
    shown += [by_revision[key] for key in query.get("revids", "").split("|") if key in by_revision]
    if normalized:
        answer["query"]["normalized"] = normalized
    props = query.get("prop", "")
    answer["query"]["pages"] = [
        {**page, **site.names(page, props)} if "revisions" in page else page for page in shown
    ]


def _json(answer: dict[str, Any], root: str, headers: dict[str, str] | None = None) -> Response:
    text = json.dumps(answer, ensure_ascii=False).replace(HOST, root)
    return Response(text, mimetype="application/json", headers=headers)
