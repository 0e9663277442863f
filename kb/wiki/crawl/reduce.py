"""Applies raw answers to the frontier, both live ones and those of a replay.

kind      key              an item is
site      round            the wiki's description of itself, once a round; removed when answered
          "answered"       done since the first answer; reopened when raw data have lost it
titles    round:namespace  the list of a namespace's pages
info      round:title      a title whose page is requested
gone      round            a round to compare with the known pages; removed afterwards
pages     page id          a page, captured when its revision has changed
files     URL              an original image file

Rounds of the complete list are "1", "2" …; rounds of named titles are "t1", "t2" … .
"""

from typing import Any

import msgspec
from msgspec.structs import replace

from kb.store.rawlog.rawlog import SEEDS, Envelope
from kb.store.state.frontier import Frontier
from kb.wiki.parse import answers

# Reasons for which a page is too large, and what in [wiki] allows more.
TOO_LARGE = {"too_tall": "max_page_height", "too_many_elements": "max_elements"}
SITE = "site:"  # cursor, by round: the namespaces that are listed
ANSWERED = "answered"  # the item that is done as long as raw data hold a description of the wiki
LEFT = ("deleted", "moved")  # reasons of pages that do not exist any more


class SiteItem(msgspec.Struct):
    """`listed`: list these namespaces, by default those that the wiki calls content."""

    listed: bool
    namespaces: tuple[int, ...] = ()


class List(msgspec.Struct):
    """`going` is the `continue` of the last answer, at first empty; `read` parts came so far."""

    round: int
    namespace: int
    going: dict[str, str | int] = {}
    read: int = 0


class Title(msgspec.Struct):
    """A listed or named title."""

    title: str


class PageItem(msgspec.Struct):
    """A page by its newest answer.

    `round` is the newest one that listed it, 0 when none did. `rendered` is the captured (revision,
    title). `former` are its previous titles. `final` is why a page is too large to be captured:
    (revision, title, reason, value). `gone`: the page had once disappeared from the wiki.
    `touched` is when the wiki last made the page anew. `withheld`: the (revision, touched) in place
    of which the wiki showed another revision: an edit that waits for its review, or an old copy.
    """

    title: str
    url: str
    revision_id: int
    round: int = 0
    rendered: tuple[int, str] | None = None
    former: list[str] = []
    final: tuple[int, str, str, str | None] | None = None
    gone: bool = False
    touched: str | None = None
    withheld: tuple[int, str | None] | None = None


class ImageItem(msgspec.Struct):
    """An image: its address, its title on the wiki where it has one, and where it was seen."""

    key: str
    title: str | None = None
    src: str | None = None


PAYLOADS: dict[str, type[msgspec.Struct]] = {
    "site": SiteItem,
    "titles": List,
    "info": Title,
    "pages": PageItem,
    "files": ImageItem,
}


def reduce(frontier: Frontier, kind: str, envelope: Envelope) -> None:
    """Apply one envelope to the frontier; idempotent."""
    takes = {
        SEEDS: _seeds,
        "site": _site,
        "titles": _titles,
        "pages": _pages,
        "renders": _renders,
        "files": _files,
    }
    if kind in takes:  # what the wiki says of its files is read from the raw answers only
        takes[kind](frontier, envelope)


def _site(frontier: Frontier, envelope: Envelope) -> None:
    """The wiki's description of itself tells waiting rounds what to list."""
    spaces = envelope.response.get("query", {}).get("namespaces", {})
    content = sorted(int(key) for key, space in spaces.items() if space.get("content"))
    counts = envelope.response.get("query", {}).get("statistics")
    counted = counts.get("pages") if isinstance(counts, dict) else None
    pages = counted if isinstance(counted, int) else 0
    frontier.add_keys("site", [(ANSWERED, SiteItem(listed=False))])
    frontier.done("site", ANSWERED)
    for tag, _, _, site in list(frontier.items("site")):
        if tag == ANSWERED:
            continue
        namespaces = sorted(site.namespaces) or content or [0]
        frontier.set_cursor(SITE + tag, {"namespaces": namespaces, "pages": pages})
        frontier.remove("site", [tag])
        if site.listed:
            add_lists(frontier, int(tag))


def add_lists(frontier: Frontier, number: int) -> None:
    """Add the lists of a round once its namespaces are known."""
    known = frontier.cursor(SITE + str(number))
    if known is not None:
        lists = (
            (f"{number}:{namespace}", List(number, namespace)) for namespace in known["namespaces"]
        )
        frontier.add_keys("titles", lists)
        _compare_when_listed(frontier, number)


def _seeds(frontier: Frontier, envelope: Envelope) -> None:
    params = envelope.request.params
    titles = params.get("titles", [])
    frontier.add_keys("info", [(f"{params['round']}:{title}", Title(title)) for title in titles])


def _titles(frontier: Frontier, envelope: Envelope) -> None:
    params, answer = envelope.request.params, envelope.response
    number, namespace = params["round"], int(params["apnamespace"])
    listed = answer.get("query", {}).get("allpages", [])
    frontier.add_keys(
        "info", [(f"{number}:{page['title']}", Title(page["title"])) for page in listed]
    )
    key, going = f"{number}:{namespace}", answer.get("continue") or {}
    frontier.add_keys("titles", [(key, List(number, namespace))])
    _, before, _ = frontier.get("titles", key) or ("", List(number, namespace), None)
    read = before.read + (before.going != going)
    frontier.payload("titles", key, List(number, namespace, going, read))
    frontier.mark("titles", [key], "todo" if going else "done")
    _compare_when_listed(frontier, number)


def _compare_when_listed(frontier: Frontier, number: int) -> None:
    """Schedule the comparison of a round once all its namespaces are listed."""
    if frontier.cursor(SITE + str(number)) is None:
        return
    waiting = frontier.items("titles", "todo", "in_progress", "error")
    if not any(payload.round == number for *_, payload in waiting):
        frontier.add_keys("gone", [str(number)])


def _pages(frontier: Frontier, envelope: Envelope) -> None:
    params, query = envelope.request.params, envelope.response.get("query", {})
    tag = str(params["round"])  # "r" for a single revision
    states = dict.fromkeys(answers.elsewhere(query), "interwiki")
    for page in query.get("pages", []):
        key, state = str(page.get("pageid")), answers.state(page)
        if state == "redirect":
            _mark_left(frontier, key, "moved")
        elif state == "missing":
            _mark_left(frontier, key, "deleted")
        elif state == "there":
            # Without these no browser can show it; what else it lacks, the filter rejects by name.
            needed = {"title": str, "pageid": int, "fullurl": str, "revid": int}
            values = page | page["revisions"][0]
            if all(values.get(k) and isinstance(values[k], kind) for k, kind in needed.items()):
                _update_page(frontier, tag, page, page["revisions"][0])
            else:
                state = "unanswered"
        states[page.get("title")] = state
    names, asked = answers.renamed(query), answers.asked(params)
    if turned := {change["from"] for change in query.get("redirects", [])}:
        for key, *_, page in list(frontier.items("pages", "done", "todo", "error")):
            if page.title in turned:
                _mark_left(frontier, key, "moved")
    if tag != "r":  # a replay may come to the answers before the lists
        frontier.add_keys("info", [(f"{tag}:{title}", Title(title)) for title in asked])
    for title in asked:
        state = states.get(names.get(title, title), "unanswered")
        if state == "there":
            frontier.done("info", f"{tag}:{title}")
        elif state != "unanswered":
            frontier.skip("info", f"{tag}:{title}", state)


def _mark_left(frontier: Frontier, key: str, reason: str) -> None:
    """A known page was deleted or moved; unknown ones are ignored. `gone` stays when it is back."""
    known = frontier.get("pages", key)
    if known is not None:
        frontier.payload("pages", key, replace(known[1], gone=True))
        frontier.skip("pages", key, reason)


def _update_page(
    frontier: Frontier, tag: str, page: dict[str, Any], revision: dict[str, Any]
) -> None:
    key, number = str(page["pageid"]), int(tag) if tag.isdigit() else 0
    new = PageItem(page["title"], page["fullurl"], revision["revid"], number)
    new.touched = page.get("touched")
    known = frontier.get("pages", key)
    if known is None:
        frontier.add_keys("pages", [(key, new)])
        return
    status, old, _ = known
    former = set(old.former)
    if old.title != new.title:
        former = {*former, old.title} - {new.title}
    new = replace(
        old,
        title=new.title,
        url=new.url,
        revision_id=new.revision_id,
        round=max(number, old.round),
        former=sorted(former),
        touched=old.touched if tag == "r" else new.touched,
    )
    frontier.payload("pages", key, new)
    now = (new.revision_id, new.title)
    if new.rendered == now:
        if status == "skipped" or (tag == "r" and status == "in_progress"):
            frontier.done("pages", key)
    elif new.final and new.final[:2] == now:
        if status == "skipped":  # may have been gone meanwhile
            frontier.skip("pages", key, new.final[2])
    elif status != "in_progress":
        # What is withheld is not rendered again: the shown revision is asked for next.
        withheld = new.rendered is not None and is_withheld(new, page)
        frontier.mark("pages", [key], "in_progress" if withheld else "todo")


def is_withheld(known: PageItem, page: dict[str, Any]) -> bool:
    """Whether the wiki, as it answers now, shows an earlier revision of a page than its newest."""
    now = (page["revisions"][0].get("revid"), page.get("touched"))
    return known.withheld == now and (known.rendered or (0, ""))[1] == page.get("title")


def _renders(frontier: Frontier, envelope: Envelope) -> None:
    """A page was captured, can't be captured, or failed after its tries.

    A page that is too large is skipped until its revision changes or the profile allows more; any
    other page that can't be captured is tried once a round.
    """
    answer = envelope.response
    key, outcome = str(answer["page_id"]), answer["outcome"]
    known = frontier.get("pages", key)
    if outcome == "captured":
        if known is not None:
            rendered = (answer["revision_id"], answer["title"])
            wanted = answer.get("wanted_revision", rendered[0])
            withheld = (wanted, known[1].touched) if wanted != rendered[0] else None
            page = replace(known[1], rendered=rendered, withheld=withheld)
            frontier.payload("pages", key, page)
        frontier.done("pages", key)
        files = [ImageItem(file["key"], file["title"], file["src"]) for file in answer["files"]]
        frontier.add_keys("files", [(file.key, file) for file in files])
        for file in files:  # a replay may know a file by its answer alone
            known_file = frontier.get("files", file.key)
            if known_file is not None and known_file[1] is None:
                frontier.payload("files", file.key, file)
        return
    reason = answer["reason"]
    if outcome not in ("robots", "final"):
        frontier.error("pages", key, reason)
        return
    if known is not None and reason in TOO_LARGE:
        final = (answer["wanted_revision"], answer["title"], reason, answer["value"])
        frontier.payload("pages", key, replace(known[1], final=final))
    frontier.skip("pages", key, reason)


def _files(frontier: Frontier, envelope: Envelope) -> None:
    answer = envelope.response
    key = answer["key"]
    if answer["outcome"] in ("stored", "final"):
        frontier.add_keys(
            "files", [key]
        )  # a replay comes to the answer before the page that shows it
    if answer["outcome"] == "stored":
        frontier.done("files", key)
    elif answer["outcome"] == "final":
        frontier.skip("files", key, answer["reason"])
    else:
        frontier.error("files", key, answer["reason"])


def missing(frontier: Frontier) -> int:
    """The number of titles without a page, over all rounds."""
    return len({key.partition(":")[2] for key, *_ in frontier.items("info", "skipped")})


def crawled(frontier: Frontier) -> int:
    """The number of pages with an outcome in all runs: captured, disallowed, rejected, missing."""
    skipped = frontier.items("pages", "skipped")
    left = sum(reason in (*LEFT, "removed") for _, _, reason, _ in skipped)
    pages = frontier.counts("pages")
    return pages.get("done", 0) + pages.get("skipped", 0) - left + missing(frontier)
