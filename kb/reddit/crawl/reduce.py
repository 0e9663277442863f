"""What Reddit's answers mean for the frontier; the same live and in a replay.

listing   "new", "top:all", "search:guide" …            Listing
tree      bare post ids                                 Post
more      bare comment ids behind stubs                 Stub
thread    "<post>/<comment>" of "continue this thread"
info      full names that are asked for by name         Named
"""

from typing import Any

import msgspec

from kb.reddit.parse import answer_tree
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier

PAGES = 10  # of 100: Reddit ends a listing at about 1,000
AGAIN = "came back as a stub"
# Why an item is not read by this crawl; one with another span, or none, reads it.
OUTSIDE = "outside --since/--until"
# Newest first; the other listings have no order that a later round could end by.
_BY_TIME = ("new", "search")


class ListingCursor(msgspec.Struct):
    """How far a listing was read. Moments are seconds of Unix time.

    after    the token of the next page
    pages    how many pages of this round were read
    oldest   when the oldest post of the last page was made
    newest   when the newest post of this round or the one before was made
    upto     up to when the round before had read
    """

    after: str | None = None
    pages: int = 0
    oldest: float | None = None
    newest: float | None = None
    upto: float | None = None


class PostItem(msgspec.Struct):
    """When a post was made, in seconds of Unix time, as far as its listing said so."""

    created_utc: float | None = None


class StubItem(msgspec.Struct):
    """The post that a comment behind a stub belongs to."""

    post: str


class RefreshItem(msgspec.Struct):
    """What is read again.

    post     the post that it belongs to, "" where nobody said
    there    whether the last answer still had it
    """

    post: str = ""
    there: bool = True


PAYLOADS: dict[str, type[msgspec.Struct]] = {
    "listing": ListingCursor,
    "tree": PostItem,
    "more": StubItem,
    "info": RefreshItem,
}


def listing_key(endpoint: str, params: dict[str, Any]) -> str:
    """The frontier's name of a listing request."""
    name = endpoint.rpartition("/")[2]
    extra = params.get("q") if name == "search" else params.get("t")
    return f"{name}:{extra}" if extra else name


def fullname(kind: str, key: str) -> str:
    """The full name of an item that is asked for, "" of a listing."""
    if kind == "info":
        return key
    return {
        "tree": f"t3_{key}",
        "more": f"t1_{key}",
        "thread": f"t1_{key.partition('/')[2]}",
    }.get(kind, "")


def reduce(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Take one answer in. Idempotent."""
    params, response = envelope.request.params, envelope.response
    if kind == "listings":
        _listing(frontier, listing_key(envelope.request.endpoint, params), params, response)
    elif kind == "comments":
        _page(frontier, params, envelope.status, response)
    elif kind == "morechildren":
        _more(frontier, params, response)
    elif kind == "info":
        frontier.done("info", *str(params["id"]).split(","))


def _more(frontier: Frontier, params: dict[str, Any], response: Any) -> None:
    """Some may come back as a stub: they are asked once more as long as that settles any."""
    _stubs(frontier, answer_tree.bare(params["link_id"]), response)
    stubs = (thing.data for thing in answer_tree.things(response) if thing.kind == "more")
    unresolved = {key for stub in stubs for key in answer_tree.stub_ids(stub)}
    asked = str(params["children"]).split(",")
    settled = [key for key in asked if key not in unresolved]
    frontier.done("more", *settled)
    if settled:
        frontier.mark("more", unresolved.intersection(asked), "todo")
    else:
        frontier.mark("more", asked, "error", AGAIN)


def _listing(frontier: Frontier, key: str, params: dict[str, Any], response: Any) -> None:
    posts = [
        (thing.data["id"], PostItem(_seconds(thing.data.get("created_utc"))))
        for thing in answer_tree.things(response)
        if thing.kind == answer_tree.POST and thing.data.get("id")
    ]
    frontier.add("tree", posts)
    frontier.add("listing", [key])
    before = (frontier.get("listing", key) or ("", None, None))[1] or ListingCursor()
    made = [post.created_utc for _, post in posts if post.created_utc is not None]
    known = [moment for moment in (before.newest, before.upto) if moment is not None]
    now = ListingCursor(
        after=answer_tree.after(response),
        pages=int(params.get("count", 0)) // 100 + 1,
        oldest=min(made, default=None),
        newest=max([*made, *known], default=None),
        upto=before.upto,
    )
    frontier.payload("listing", key, now)
    over = now.after is None or now.pages >= PAGES or _reaches_back(key, now)
    frontier.mark("listing", [key], "done" if over else "todo")


def _reaches_back(key: str, now: ListingCursor) -> bool:
    """Whether the last page shows what the round before had: the rest is known then."""
    if key.partition(":")[0] not in _BY_TIME or now.upto is None or now.oldest is None:
        return False
    return now.oldest < now.upto


def _seconds(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value)


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
    for thing in answer_tree.things(response):
        if thing.kind == "more":
            frontier.add(
                "more", [(key, StubItem(post)) for key in answer_tree.stub_ids(thing.data)]
            )
            if answer_tree.is_continuation(thing.data):
                frontier.add("thread", [f"{post}/{answer_tree.bare(thing.data['parent_id'])}"])


def outside(frontier: Frontier) -> int:
    """Posts that lie outside of the dates of the last crawl."""
    return sum(reason == OUTSIDE for _, _, reason, _ in frontier.items("tree", "skipped"))


def crawled(frontier: Frontier) -> int:
    """Posts that were answered for in all runs, missing ones among them."""
    counts = frontier.counts("tree")
    return counts.get("done", 0) + counts.get("skipped", 0) - outside(frontier)


def incomplete_posts(frontier: Frontier) -> dict[str, str]:
    """Posts of which a part of the tree failed after its tries: bare id → the reason of one part.

    The next crawl tries the part again.
    """
    reasons: dict[str, str] = {}
    for key, _, reason, _ in frontier.items("tree", "error"):
        reasons.setdefault(key, reason or "failed")
    for key, _, reason, _ in frontier.items("thread", "error"):
        reasons.setdefault(key.partition("/")[0], reason or "failed")
    for _, _, reason, payload in frontier.items("more", "error"):
        reasons.setdefault(payload.post, reason or "failed")
    return reasons
