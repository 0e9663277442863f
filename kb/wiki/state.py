"""What each raw answer means for the frontier. The same function takes live answers and replays.

kind        key            what is done with it
info        round:title    asked for revision, address, contributors (50 a call)
pages       page id        rendered when its revision is not the one that was rendered
files       address        the original picture is fetched
"""

from __future__ import annotations

from typing import Any

from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope


def apply(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Take one envelope into the frontier; idempotent."""
    {"titles": _titles, "pages": _pages, "renders": _renders, "files": _files}.get(kind, _nothing)(frontier, envelope)


def _nothing(frontier: Frontier, envelope: Envelope) -> None:
    """Site facts and picture facts are read from the raw answers only."""


def _titles(frontier: Frontier, envelope: Envelope) -> None:
    """A piece of the list of all pages: what is to be asked, and where the list goes on."""
    params, answer = envelope.request.params, envelope.response
    number, namespace = params["round"], params["apnamespace"]
    listed = answer.get("query", {}).get("allpages", [])
    frontier.add("info", [(f"{number}:{page['title']}", {"title": page["title"]}) for page in listed])
    frontier.set_cursor(f"list:{number}:{namespace}", answer.get("continue") or "done")


def _pages(frontier: Frontier, envelope: Envelope) -> None:
    """Revision, address and place of up to 50 pages."""
    params, query = envelope.request.params, envelope.response.get("query", {})
    tag = str(params["round"])  # "t1" for the first round of named titles, "r" for a single revision
    number = int(tag) if tag.isdigit() else 0
    answered: set[str] = set()
    for page in query.get("pages", []):
        title, key = page.get("title"), str(page.get("pageid"))
        revision = (page.get("revisions") or [None])[0]
        answered.add(title)
        if page.get("redirect") and revision:
            _gone(frontier, key, "moved")
        elif page.get("missing") and page.get("pageid"):
            _gone(frontier, key, "deleted")
        elif revision and page.get("pageid"):
            frontier.done("info", f"{tag}:{title}")
            _note(frontier, number, page, revision)
            continue
        reason = "invalid" if page.get("invalid") else "redirect" if page.get("redirect") else "missing"
        frontier.skip("info", f"{tag}:{title}", reason)
    for change in query.get("normalized", []):
        if change["to"] in answered:
            frontier.done("info", f"{tag}:{change['from']}")


def _gone(frontier: Frontier, key: str, reason: str) -> None:
    """A known page that is no page any more; others were never ours. `gone` stays when it comes back."""
    if known := frontier.get("pages", key):
        frontier.payload("pages", key, {**(known[1] or {}), "gone": True})
        frontier.skip("pages", key, reason)


def _note(frontier: Frontier, number: int, page: dict[str, Any], revision: dict[str, Any]) -> None:
    key = str(page["pageid"])
    known = frontier.get("pages", key)
    old = known[1] if known else {}
    payload = {
        "title": page["title"],
        "url": page.get("fullurl"),
        "revision_id": revision["revid"],
        "round": max(number, old.get("round", 0)),
        "rendered": old.get("rendered"),
        "former": old.get("former", []),
        # States of earlier versions don't say it: there a skipped page may be one that had gone.
        "gone": old.get("gone", known is not None and known[0] == "skipped"),
    }
    if known is None:
        frontier.add("pages", [(key, payload)])
        return
    if old["title"] != page["title"]:
        payload["former"] = sorted({*payload["former"], old["title"]} - {page["title"]})
    frontier.payload("pages", key, payload)
    if payload["rendered"] != [revision["revid"], page["title"]]:
        if known[0] != "in_progress":
            frontier.mark("pages", [key], "todo")
    elif known[0] == "skipped":
        frontier.done("pages", key)


def _renders(frontier: Frontier, envelope: Envelope) -> None:
    """A page was captured, or failed after its tries."""
    answer = envelope.response
    key = str(answer["page_id"])
    known = frontier.get("pages", key)
    if answer["outcome"] != "captured":
        final = answer["outcome"] == "robots"
        frontier.mark("pages", [key], "skipped" if final else "error", answer["reason"])
        return
    if known:
        frontier.payload("pages", key, {**(known[1] or {}), "rendered": [answer["revision_id"], answer["title"]]})
    frontier.done("pages", key)
    frontier.add("files", [(file["key"], file) for file in answer["files"]])


def _files(frontier: Frontier, envelope: Envelope) -> None:
    """A picture file was fetched, or could not be."""
    answer = envelope.response
    key = answer["key"]
    if answer["outcome"] == "stored":
        frontier.done("files", key)
    elif answer["outcome"] == "final":
        frontier.skip("files", key, answer["reason"])
    else:
        frontier.error("files", key, answer["reason"])
