"""What Reddit's answers mean for the frontier; the same live and in replay.

listing   "new", "top:all", "search:guide" …   payload: next page, pages read, when the last page's oldest post and
                                                the round's newest were made, up to when the round before had read
tree      bare post ids                         payload: when the post was made
more      bare comment ids behind stubs         payload: their post
thread    "<post>/<comment>" of "continue this thread"
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.reddit import tree
from kb.store import reading
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope

ASKED = ("listing", "tree", "more", "thread")  # what a crawl asks for
PAGES = 10  # of 100: Reddit ends a listing at about 1,000
OUTSIDE = (
    "outside --since/--until"  # not read by this crawl; one with another span, or none, reads it
)
AGAIN = "came back as a stub"
COMMENTS, REPLIES = "comments", "replies"  # parts that failed, behind the name of what they are of
_BY_TIME = (
    "new",
    "search",
)  # newest first; the other listings have no order that a later round could end by


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
        # Some may come back as a stub again: they are asked once more as long as that settles any.
        again = {
            key
            for thing in tree.things(response)
            if thing.kind == "more"
            for key in tree.stub_ids(thing.data)
        }
        settled = [key for key in asked if key not in again]
        frontier.done("more", *settled)
        if settled:
            frontier.release("more", *again.intersection(asked))
        else:
            frontier.mark("more", asked, "error", AGAIN)
    elif kind == "info":
        frontier.done("info", *str(params["id"]).split(","))


def _listing(frontier: Frontier, key: str, params: dict[str, Any], response: Any) -> None:
    posts = [
        thing.data
        for thing in tree.things(response)
        if thing.kind == tree.POST and thing.data.get("id")
    ]
    frontier.add("tree", [(post["id"], {"created_utc": post.get("created_utc")}) for post in posts])
    frontier.add("listing", [key])
    pages = int(params.get("count", 0)) // 100 + 1
    token = tree.after(response)
    before = (frontier.get("listing", key) or ("", None, None))[1] or {}
    made = [
        float(post["created_utc"])
        for post in posts
        if isinstance(post.get("created_utc"), (int, float))
    ]
    oldest, upto = min(made, default=None), before.get("upto")
    newest = max(
        [*made, *(moment for moment in (before.get("newest"), upto) if moment is not None)],
        default=None,
    )
    frontier.payload(
        "listing",
        key,
        {"after": token, "pages": pages, "oldest": oldest, "newest": newest, "upto": upto},
    )
    # In a later round a page that reaches back behind the newest post of the round before means that the rest is known.
    known = (
        key.partition(":")[0] in _BY_TIME
        and upto is not None
        and oldest is not None
        and oldest < upto
    )
    frontier.mark("listing", [key], "done" if token is None or pages >= PAGES or known else "todo")


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


def outside(frontier: Frontier) -> int:
    """Posts that lie outside of the dates of the last crawl."""
    return sum(reason == OUTSIDE for _, _, reason, _ in frontier.items("tree", "skipped"))


def crawled(frontier: Frontier) -> int:
    """Posts that were answered for in all runs, missing ones among them."""
    counts = frontier.counts("tree")
    return counts.get("done", 0) + counts.get("skipped", 0) - outside(frontier)


def unread_parts(frontier: Frontier) -> dict[str, str]:
    """Posts of which a part of the tree failed after its tries: bare id → the reason of one part.

    The next crawl tries the part again.
    """
    found: dict[str, str] = {}
    for key, _, reason, _ in frontier.items("tree", "error"):
        found.setdefault(key, reason or "failed")
    for key, _, reason, _ in frontier.items("thread", "error"):
        found.setdefault(key.partition("/")[0], reason or "failed")
    for _, _, reason, payload in frontier.items("more", "error"):
        found.setdefault(payload["post"], reason or "failed")
    return found


def incomplete_posts(root: Path) -> dict[str, str]:
    """The same of a data root; nothing where no crawl was."""
    path = root / "state" / "reddit.sqlite"
    if not path.exists():
        return {}
    with reading.state(path) as frontier:
        return unread_parts(frontier)


def incomplete(root: Path) -> dict[str, int]:
    """For summaries: how many posts have a part that could not be read."""
    return {"incomplete_posts": len(incomplete_posts(root))}


def gave_up(root: Path) -> Iterator[tuple[str, str]]:
    """(key, reason) of what failed after its tries, or is shut: `failed` in the filter where no answer tells of it.

    A key is a full name. Where a page failed it is the name of what the page is of and what was to be on it:
    `t3_…/comments`, `t1_…/replies`; the post or comment itself may well be kept.
    """
    path = root / "state" / "reddit.sqlite"
    if not path.exists():
        return
    with reading.state(path) as frontier:
        for key, _, reason, _ in frontier.items("more", "error"):
            yield f"t1_{key}", reason or "failed"
        for key, _, reason, _ in frontier.items("thread", "error"):
            yield f"t1_{key.partition('/')[2]}/{REPLIES}", reason or "failed"
        for key, _, reason, _ in frontier.items("tree", "error"):
            yield f"t3_{key}/{COMMENTS}", reason or "failed"
        for key, _, reason, _ in frontier.items("tree", "skipped"):
            if reason not in (OUTSIDE, "purged", "404", "410"):
                yield f"t3_{key}", reason or "failed"
