"""What the frontier of a crawl begins with, and what Reddit's answers mean for it; the same live
and in a replay.

listing   "new", "top:all", "search:guide" …            ListingCursor
tree      bare post ids                                 PostItem
more      bare comment ids behind stubs                 StubItem
thread    "<post>/<comment>" of "continue this thread"
info      full names that are asked for by name         RefreshItem
"""

from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from kb.reddit.parse import answer_tree
from kb.reddit.section import RedditSection as Section
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
    """When a post was made, in seconds of Unix time, as far as its listing said so, and how many
    parts of its comments came after its page.
    """

    created_utc: float | None = None
    parts: int = 0


class StubItem(msgspec.Struct):
    """The post that a comment behind a stub belongs to."""

    post: str


class RefreshItem(msgspec.Struct):
    """What is read again.

    post     the post that it belongs to, "" where it is not known
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


def fullname(kind: str, key: str) -> str:
    """The full name of an item that is asked for, "" of a listing."""
    if kind == "info":
        return key
    return {
        "tree": f"t3_{key}",
        "more": f"t1_{key}",
        "thread": f"t1_{key.partition('/')[2]}",
    }.get(kind, "")


def _count_part(frontier: Frontier, post: str) -> None:
    _, known, _ = frontier.get("tree", post) or ("", None, None)
    known = known or PostItem()
    frontier.payload("tree", post, replace(known, parts=known.parts + 1))


def reduce(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Take one answer in. Idempotent."""
    params, response = envelope.request.params, envelope.response
    if kind == "listings":
        _listing(frontier, envelope.request.endpoint, params, response)
    elif kind == "comments":
        _page(frontier, params, envelope.status, response)
    elif kind == "morechildren":
        _more(frontier, params, response)
    elif kind == "info":
        frontier.done("info", *str(params["id"]).split(","))


def _more(frontier: Frontier, params: dict[str, Any], response: Any) -> None:
    """Some may come back as a stub: they are asked once more as long as that settles any."""
    post = answer_tree.bare(params["link_id"])
    _count_part(frontier, post)
    _stubs(frontier, post, response)
    stubs = (thing.data for thing in answer_tree.things(response) if thing.kind == "more")
    unresolved = {key for stub in stubs for key in answer_tree.stub_ids(stub)}
    asked = str(params["children"]).split(",")
    settled = [key for key in asked if key not in unresolved]
    frontier.done("more", *settled)
    if settled:
        frontier.mark("more", unresolved.intersection(asked), "todo")
    else:
        frontier.mark("more", asked, "error", AGAIN)


def _listing(frontier: Frontier, endpoint: str, params: dict[str, Any], response: Any) -> None:
    name = endpoint.rpartition("/")[2]
    extra = params.get("q") if name == "search" else params.get("t")
    key = f"{name}:{extra}" if extra else name
    posts = [
        (thing.data["id"], PostItem(_seconds(thing.data.get("created_utc"))))
        for thing in answer_tree.things(response)
        if thing.kind == answer_tree.POST and thing.data.get("id")
    ]
    frontier.add_keys("tree", posts)
    frontier.add_keys("listing", [key])
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
    over = now.after is None or now.pages >= PAGES
    if is_by_time(name) and now.upto is not None and now.oldest is not None:
        over = over or now.oldest < now.upto  # the rest is known from the round before
    frontier.mark("listing", [key], "done" if over else "todo")


def is_by_time(listing: str) -> bool:
    """Whether a listing has its newest posts first: a later round ends at the known ones."""
    return listing.partition(":")[0] in _BY_TIME


def _seconds(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value)


def _page(frontier: Frontier, params: dict[str, Any], status: int, response: Any) -> None:
    post, comment = str(params["article"]), params.get("comment")
    kind, key = ("thread", f"{post}/{comment}") if comment else ("tree", post)
    frontier.add_keys(kind, [key])
    if comment:
        _count_part(frontier, post)
    if status == 200:
        _stubs(frontier, post, response)
        frontier.done(kind, key)
    else:
        frontier.skip(kind, key, str(status))


def _stubs(frontier: Frontier, post: str, response: Any) -> None:
    for thing in answer_tree.things(response):
        if thing.kind == "more":
            frontier.add_keys(
                "more", [(key, StubItem(post)) for key in answer_tree.stub_ids(thing.data)]
            )
            if answer_tree.is_continuation(thing.data):
                frontier.add_keys("thread", [f"{post}/{answer_tree.bare(thing.data['parent_id'])}"])


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


KINDS = ("listing", "tree", "more", "thread")


class Span(NamedTuple):
    """When the posts that are wanted were made, in seconds of Unix time."""

    since: float | None = None
    until: float | None = None

    def excludes(self, post: PostItem | None) -> bool:
        """Whether a post was made outside of it; one of unknown time was not."""
        return post is not None and answer_tree.outside(post.created_utc, self.since, self.until)

    def is_behind(self, key: str, listing: ListingCursor | None) -> bool:
        """Whether all that a listing still has is older."""
        if key != "new" or listing is None:
            return False
        return answer_tree.outside(listing.oldest, self.since, None)


def listings(section: Section) -> list[str]:
    """The names of the profile's listings and searches, as the frontier has them."""
    names = []
    for listing in section.listings:
        if listing in ("top", "controversial"):
            names += [f"{listing}:{span}" for span in section.spans]
        else:
            names.append(listing)
    return names + [f"search:{word}" for word in section.search]


def seed(frontier: Frontier, section: Section, span: Span, *, new_round: bool) -> bool:
    """Add the listings, and what another span had left out; whether anything is to be read.

    `new_round` starts a new round where the last one is complete.
    """
    names = listings(section)
    frontier.add_keys("listing", names)
    inside = [
        key
        for key, _, reason, post in frontier.items("tree", "skipped")
        if reason == OUTSIDE and not span.excludes(post)
    ]
    frontier.mark("tree", inside, "todo")
    ahead = [
        key
        for key, _, reason, listing in frontier.items("listing", "skipped")
        if reason == OUTSIDE and not span.is_behind(key, listing)
    ]
    frontier.mark("listing", ahead, "todo")
    if new_round and not frontier.ready("listing"):
        _new_round(frontier, names)
    return bool(frontier.open(*KINDS))


def _new_round(frontier: Frontier, names: list[str]) -> None:
    """Every listing from its first page; those by time up to where the last round began."""
    for name, status, reason, last in frontier.items("listing", "done", "skipped"):
        if name not in names or (status == "skipped" and reason != OUTSIDE):
            continue
        upto = last.newest if last is not None and status == "done" else None
        frontier.payload("listing", name, ListingCursor(upto=upto))
        frontier.mark("listing", [name], "todo")
