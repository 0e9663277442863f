"""What Reddit's answers mean for the frontier; the same live and in replay.

listing   "new", "top:all", "search:guide" …   payload: next page, pages read
tree      bare post ids                         payload: when the post was made
more      bare comment ids behind stubs         payload: their post
thread    "<post>/<comment>" of "continue this thread"
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.reddit import tree
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope

PAGES = 10  # of 100: Reddit ends a listing at about 1,000


def listing_key(endpoint: str, params: dict[str, Any]) -> str:
    """The frontier's name of a listing request."""
    name = endpoint.rpartition("/")[2]
    extra = params.get("q") if name == "search" else params.get("t")
    return f"{name}:{extra}" if extra else name


def apply(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Take one answer in. Idempotent."""
    params, response = envelope.request.params, envelope.response
    if kind == "listings":
        _listing(frontier, listing_key(envelope.request.endpoint, params), params, response)
    elif kind == "comments":
        _page(frontier, params, envelope.status, response)
    elif kind == "morechildren":
        _stubs(frontier, tree.bare(params["link_id"]), response)
        asked = str(params["children"]).split(",")
        # Some may come back as a stub again: they are asked once more as long as that brings anything.
        again = {key for thing in tree.things(response) if thing.kind == "more" for key in tree.stub_ids(thing.data)}
        brought = any(thing.kind == tree.COMMENT for thing in tree.things(response))
        frontier.done("more", *(key for key in asked if not (brought and key in again)))
        frontier.release("more", *(key for key in asked if brought and key in again))
    elif kind == "info":
        frontier.done("info", *str(params["id"]).split(","))


def _listing(frontier: Frontier, key: str, params: dict[str, Any], response: Any) -> None:
    posts = [thing.data for thing in tree.things(response) if thing.kind == tree.POST and thing.data.get("id")]
    new = frontier.add("tree", [(post["id"], {"created_utc": post.get("created_utc")}) for post in posts])
    frontier.add("listing", [key])
    pages = int(params.get("count", 0)) // 100 + 1
    token = tree.after(response)
    known = frontier.get("listing", key)
    again = bool(known and known[1] and known[1].get("again"))
    oldest = min((float(post["created_utc"]) for post in posts if isinstance(post.get("created_utc"), (int, float))), default=None)
    frontier.payload("listing", key, {"after": token, "pages": pages, "again": again, "oldest": oldest})
    # In a later round a page without a new post means that the rest is known.
    frontier.mark("listing", [key], "done" if token is None or pages >= PAGES or (again and not new) else "todo")


def _page(frontier: Frontier, params: dict[str, Any], status: int, response: Any) -> None:
    post, comment = str(params["article"]), params.get("comment")
    kind, key = ("thread", f"{post}/{comment}") if comment else ("tree", post)
    frontier.add(kind, [key])
    if status == 200:
        _stubs(frontier, post, response)
        frontier.done(kind, key)
    else:
        frontier.skip(kind, key, str(status))


def _stubs(frontier: Frontier, post: str, response: Any) -> None:
    for thing in tree.things(response):
        if thing.kind == "more":
            frontier.add("more", [(key, {"post": post}) for key in tree.stub_ids(thing.data)])
            if tree.is_continuation(thing.data):
                frontier.add("thread", [f"{post}/{tree.bare(thing.data['parent_id'])}"])


def gave_up(root: Path) -> Iterator[tuple[str, str]]:
    """(full name, reason) of what failed after its tries and has no answer: `failed` in the filter."""
    path = root / "state" / "reddit.sqlite"
    if not path.exists():
        return
    frontier = Frontier(path, readonly=True)
    try:
        for key, _, reason, _ in frontier.items("more", "error"):
            yield f"t1_{key}", reason or "failed"
    finally:
        frontier.close()
