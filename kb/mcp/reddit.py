"""What `read` shows of a thread: the post and its comments."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import SplitResult

from kb.core.errors import UsageError
from kb.mcp.around import Piece, Whole, first_row, outward
from kb.mcp.places import SourceLocation
from kb.reader import thread as threads
from kb.reader.opened import OpenTables
from kb.search.passage import plain

_THREAD = re.compile(r"/comments/(\w+)(?:/[^/]*/(\w+))?")


def of_link(url: SplitResult, query: Mapping[str, list[str]]) -> SourceLocation | None:
    """The post or comment that a URL names."""
    match = _THREAD.search(url.path)
    return SourceLocation("reddit", match[1], match[2] or "") if match else None


def around(opened: OpenTables, place: SourceLocation) -> Whole:
    if place.key.startswith("t1_"):
        row = first_row(opened, "reddit_comments", "comment_id = ?", [place.key[3:]])
        if row is None:
            raise UsageError(f"no comment {place.key[:40]!r} here", hint="`search` gives refs")
        place = SourceLocation("reddit", row["post_id"], row["comment_id"])
    thread = threads.find(opened, place.key)
    key = thread.post_id
    url = f"https://www.reddit.com/comments/{key}/"
    pieces = [Piece(SourceLocation("reddit", key), "post", url, _said(thread.body, thread.missing))]
    above: list[int] = []
    parents: list[list[int]] = [[]]
    for level, one in thread.walk():
        del above[level:]
        parents.append([*above])
        above.append(len(pieces))
        score = "" if one.score is None else f", score {one.score}"
        label = f"comment, level {level + 1}{score}, {one.created_utc.date()}"
        at = SourceLocation("reddit", key, one.comment_id)
        text = _said(one.body, one.missing)
        pieces.append(Piece(at, label, f"{url}_/{one.comment_id}/", text))
    numbers = {piece.place.at: number for number, piece in enumerate(pieces)}
    if place.at not in numbers:
        raise UsageError(f"no comment {place.at[:40]!r} under {key}", hint=f"read reddit:{key}")
    centre = numbers[place.at]
    answers = [n for n, chain in enumerate(parents) if centre in chain]
    first = [centre, *reversed(parents[centre]), 0, *answers]
    nearest = list(dict.fromkeys([*first, *outward(centre, len(pieces))]))
    date = thread.post["created_utc"].date()
    facts = f"reddit thread · {date} · no licence given, texts are their authors' · {url}"
    return Whole(facts, plain(thread.title) or key, pieces, nearest)


def _said(text: str | None, missing: str | None) -> str:
    return plain(text) if text is not None else f"[{missing or 'the text is not here'}]"
