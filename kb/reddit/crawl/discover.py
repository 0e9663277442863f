"""What a crawl of Reddit begins with: the profile's listings, new rounds of them, spans of time."""

from typing import NamedTuple

from kb.core.config.profile.collecting import RedditSection as Section
from kb.reddit.crawl.reduce import OUTSIDE, ListingCursor, PostItem
from kb.reddit.parse import answer_tree
from kb.store.state.frontier import Frontier

KINDS = ("listing", "tree", "more", "thread")


class Span(NamedTuple):
    """When the posts that are wanted were made, in seconds of Unix time."""

    since: float | None = None
    until: float | None = None

    def excludes(self, post: PostItem | None) -> bool:
        """Whether a post was made outside of it; one that nobody knows the time of was not."""
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
    frontier.add("listing", names)
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
