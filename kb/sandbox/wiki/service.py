"""The sandbox's wiki: pages, pictures, and the part of `api.php` that a crawl asks.

The pages are recorded ones (kb/sandbox/wiki/generated.py) and ones generated for a domain
(kb/sandbox/wiki/generated.py). `world.wiki_state` selects the state that is served: "first", or
"later", after some edits, a deletion, a move and a new page.
"""

import json
import mimetypes
from typing import Any

from werkzeug.utils import redirect
from werkzeug.wrappers import Request, Response

from kb.sandbox.wiki.generated import HOST, PAGES, GeneratedWiki, RecordedWiki
from kb.sandbox.world import World


def settings(url: str) -> dict[str, str]:
    """The settings that point at this wiki."""
    return {"KB_WIKI_URL": url}


def app(world: World) -> Any:
    """The WSGI application."""
    if world.domain.recorded_wiki and not world.n_named:
        site = RecordedWiki()
    else:
        site = GeneratedWiki(world.domain, PAGES if world.n_named is None else world.n_named)

    @Request.application
    def serve(request: Request) -> Response:
        later = world.wiki_state == "later"
        root, path = request.host_url.rstrip("/"), request.path
        if path == "/":
            return redirect(f"{root}/wiki/Main_Page", 301)
        if path in ("/w/api.php", "/api.php"):
            answer = _api(request.args.to_dict(), site, later, world.n_pages)
            text = json.dumps(answer, ensure_ascii=False).replace(HOST, root)
            return Response(text, mimetype="application/json")
        if path.startswith("/wiki/"):
            title = path.removeprefix("/wiki/").replace("_", " ")
            return _page(site, title, later, root, request.args.get("oldid", ""))
        data = site.file(path)
        if data is None:
            return Response("not found", 404, mimetype="text/plain")
        return Response(data, mimetype=mimetypes.guess_type(path)[0] or "application/octet-stream")

    return serve


def _page(site: RecordedWiki, title: str, later: bool, root: str, revision: str) -> Response:
    """The page as it is now, or of the revision `revision`."""
    text = site.html(title, later)
    if revision:
        states = (
            state
            for state in (later, False)
            if str(site.pages(state).get(title, {}).get("lastrevid")) == revision
        )
        text = next((site.html(title, state) for state in states), None)
    if text is not None:
        return Response(text.replace(HOST, root), mimetype="text/html")
    return Response(
        f"<!DOCTYPE html><title>{title.replace('<', '')}</title><p>There is no such page.</p>",
        404,
        mimetype="text/html",
    )


def _api(
    query: dict[str, str], site: RecordedWiki, later: bool, listed: int | None
) -> dict[str, Any]:
    answer: dict[str, Any] = {"batchcomplete": True, "query": {}}
    if query.get("meta") == "siteinfo":
        answer["query"] |= site.load("siteinfo.json")["query"]
    if query.get("list") == "allpages":
        _allpages(query, site, later, answer, listed)
    if query.get("titles") or query.get("pageids") or query.get("revids"):
        _details(query, site, later, answer)
    return answer


def _allpages(
    query: dict[str, str],
    site: RecordedWiki,
    later: bool,
    answer: dict[str, Any],
    listed: int | None,
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


def _details(
    query: dict[str, str], site: RecordedWiki, later: bool, answer: dict[str, Any]
) -> None:
    pages = site.pages(later)
    by_id = {str(page["pageid"]): page for page in pages.values()}
    by_revision = {str(page["lastrevid"]): page for page in pages.values()}
    files = {page["title"]: page for page in site.load("imageinfo.json")["query"]["pages"]}
    shown: list[dict[str, Any]] = []
    normalized, redirects = [], []
    for wanted in [title for title in query.get("titles", "").split("|") if title][:50]:
        title = wanted.replace("_", " ").strip()
        title = title[:1].upper() + title[1:]
        if title.startswith("File:"):
            title = "File:" + title[5:6].upper() + title[6:]
        if title != wanted:
            normalized.append({"fromencoded": False, "from": wanted, "to": title})
        if "redirects" in query and pages.get(title, {}).get("redirect"):
            redirects.append({"from": title, "to": site.target(title)})
            title = site.target(title)
        known = pages.get(title) or files.get(title)
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
                known
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
    if redirects:
        answer["query"]["redirects"] = redirects
    props = query.get("prop", "")
    answer["query"]["pages"] = [
        {**page, **site.names(page, props)} if "revisions" in page else page for page in shown
    ]
