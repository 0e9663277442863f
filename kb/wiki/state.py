"""What each raw answer means for the frontier. The same function takes live answers and replays.

kind        key            what is done with it
info        round:title    asked for revision, address, contributors (50 a call)
pages       page id        rendered when its revision is not the one that was rendered
files       address        the original picture is fetched
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from kb.core.profile.wiki import Wiki
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope
from kb.wiki import answers

TOO_LARGE = {
    "too_tall": "max_page_height",
    "too_many_elements": "max_elements",
}  # and what allows more in [wiki]

ASKED = ("info", "pages", "files")  # what a crawl asks for


def apply(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Take one envelope into the frontier; idempotent."""
    {"titles": _titles, "pages": _pages, "renders": _renders, "files": _files}.get(kind, _nothing)(
        frontier, envelope
    )


def _nothing(frontier: Frontier, envelope: Envelope) -> None:
    """Site facts and picture facts are read from the raw answers only."""


def _titles(frontier: Frontier, envelope: Envelope) -> None:
    """A piece of the list of all pages: what is to be asked, and where the list goes on."""
    params, answer = envelope.request.params, envelope.response
    number, namespace = params["round"], params["apnamespace"]
    listed = answer.get("query", {}).get("allpages", [])
    frontier.add(
        "info", [(f"{number}:{page['title']}", {"title": page["title"]}) for page in listed]
    )
    frontier.set_cursor(f"list:{number}:{namespace}", answer.get("continue") or "done")


def _pages(frontier: Frontier, envelope: Envelope) -> None:
    """Revision, address and place of up to 50 pages."""
    params, query = envelope.request.params, envelope.response.get("query", {})
    tag = str(
        params["round"]
    )  # "t1" for the first round of named titles, "r" for a single revision
    number = int(tag) if tag.isdigit() else 0
    states = dict.fromkeys(answers.elsewhere(query), "interwiki")
    for page in query.get("pages", []):
        key, state = str(page.get("pageid")), answers.state(page)
        if state == "redirect":
            _gone(frontier, key, "moved")
        elif state == "missing":
            _gone(frontier, key, "deleted")
        elif state == "there" and _usable(page):
            _note(frontier, number, page, page["revisions"][0])
        elif state == "there":
            state = "unanswered"
        states[page.get("title")] = state
    names = answers.renamed(query)
    for title in answers.asked(params):
        state = states.get(names.get(title, title), "unanswered")
        if state == "there":
            frontier.done("info", f"{tag}:{title}")
        elif state != "unanswered":
            frontier.skip("info", f"{tag}:{title}", state)


def _usable(page: dict[str, Any]) -> bool:
    """Whether a page has what showing it needs; what it lacks, the filter rejects by name."""
    return (
        isinstance(page["revisions"][0].get("revid"), int)
        and isinstance(page.get("fullurl"), str)
        and bool(page.get("pageid"))
        and "title" in page
    )


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
        "final": old.get("final"),
        # States of earlier versions don't say it: there a skipped page may be one that had gone.
        "gone": old.get("gone", known is not None and known[0] == "skipped"),
    }
    if known is None:
        frontier.add("pages", [(key, payload)])
        return
    if old["title"] != page["title"]:
        payload["former"] = sorted({*payload["former"], old["title"]} - {page["title"]})
    frontier.payload("pages", key, payload)
    now = [revision["revid"], page["title"]]
    if payload["rendered"] == now:
        if known[0] == "skipped":
            frontier.done("pages", key)
    elif payload["final"] and payload["final"][:2] == now:
        if known[0] == "skipped":  # may have been gone meanwhile
            frontier.skip("pages", key, payload["final"][2])
    elif known[0] != "in_progress":
        frontier.mark("pages", [key], "todo")


def _renders(frontier: Frontier, envelope: Envelope) -> None:
    """A page was captured, will not be, or failed after its tries.

    What is too large stays so until its revision changes or the profile allows more (`reopen_larger`);
    any other page that can't be shown is tried once a round.
    """
    answer = envelope.response
    key, reason = (
        str(answer["page_id"]),
        answer["reason"] if answer["outcome"] != "captured" else None,
    )
    known = frontier.get("pages", key)
    if answer["outcome"] in ("robots", "final"):
        if known and reason in TOO_LARGE:
            final = [answer["wanted_revision"], answer["title"], reason, answer["value"]]
            frontier.payload("pages", key, {**(known[1] or {}), "final": final})
        frontier.skip("pages", key, reason)
        return
    if reason is not None:
        frontier.error("pages", key, reason)
        return
    if known:
        frontier.payload(
            "pages", key, {**(known[1] or {}), "rendered": [answer["revision_id"], answer["title"]]}
        )
    frontier.done("pages", key)
    frontier.add("files", [(file["key"], file) for file in answer["files"]])


def reopen_larger(frontier: Frontier, section: Wiki) -> None:
    """Pages that were too large and may be captured as the profile is now become todo again."""
    for key, _, reason, payload in list(frontier.items("pages", "skipped")):
        final = payload.get("final")
        # Of a page's height we know how much it is, of its elements only that they were more than allowed.
        if (
            final
            and reason in TOO_LARGE
            and int(final[3]) + (reason == "too_many_elements")
            <= getattr(section, TOO_LARGE[reason])
        ):
            frontier.payload("pages", key, {**payload, "final": None})
            frontier.mark("pages", [key], "todo")


def missing(frontier: Frontier) -> int:
    """Titles that have no page, whatever the number of rounds that asked for them."""
    return len({payload["title"] for *_, payload in frontier.items("info", "skipped")})


def crawled(frontier: Frontier) -> int:
    """Pages that were answered for in all runs: captured, barred, not to be shown, or missing."""
    gone = sum(
        reason in ("deleted", "moved", "removed")
        for _, _, reason, _ in frontier.items("pages", "skipped")
    )
    pages = frontier.counts("pages")
    return pages.get("done", 0) + pages.get("skipped", 0) - gone + missing(frontier)


def reopen_moved(frontier: Frontier, today: Callable[[str], str]) -> None:
    """What was refused for its host and is reached at another address by now becomes todo again."""
    for kind in ("pages", "files"):
        moved = [
            key
            for key, _, reason, payload in frontier.items(kind, "skipped")
            if reason == "other_host"
            and today(address := (payload or {}).get("url") or key) != address
        ]
        frontier.mark(kind, moved, "todo")


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
