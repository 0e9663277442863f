"""`read`: what stands around a place, taken from the clean tables (or what was restored).

Pieces come in their own order: windows of a transcript, sections of a page with their tables, a
post and its comments. The place's own piece is taken first, then those nearest to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.artifacts import catalog
from kb.core.errors import UsageError
from kb.mcp.fence import Fence, Unit
from kb.mcp.found import revision
from kb.mcp.places import SourceLocation, anchor
from kb.reader import thread as threads
from kb.reader.opened import OpenTables
from kb.search.passage import plain
from kb.search.wiki_passages import grid, link, sections
from kb.search.youtube_passages import Talk, talk

_WATCH = "https://www.youtube.com/watch?v="


class Piece(NamedTuple):
    """A part of a thing: where it is, and its text."""

    place: SourceLocation
    label: str
    url: str
    text: str


class Whole(NamedTuple):
    """A thing in pieces; `nearest` has their numbers, from the place outward."""

    facts: str
    title: str
    pieces: list[Piece]
    nearest: list[int]


def around(root: Path, place: SourceLocation, size: int) -> str:
    """The place and as much around it as `size` characters hold. Raises UsageError, DamagedData."""
    opened = OpenTables([catalog.read(root)])
    whole = _READ[place.source](opened, place)
    fence = Fence()
    head = f"{fence.note}\n{whole.facts}"
    units = [
        Unit(f"[{piece.label}] {piece.url}", piece.text or "(no text)") for piece in whole.pieces
    ]
    title = fence.around(whole.title)
    room = size - len(head) - len(title) - 4
    spare = len(_left(whole, set())) + 40
    if room < spare + 200:  # a title of thousands of characters
        title, room = "", size - len(head) - 4
    blocks: dict[int, str] = {}
    for number in whole.nearest:
        block = units[number].whole(fence)
        if len(block) + 2 > room - spare and not blocks:
            block = units[number].within(fence, room - spare - 2)
        if len(block) + 2 > room - spare:
            break
        blocks[number] = block
        room -= len(block) + 2
    lines = [head, title, *(blocks[number] for number in sorted(blocks))]
    if len(blocks) < len(units):
        lines.append(_left(whole, set(blocks)))
    return "\n\n".join(line for line in lines if line)


def _left(whole: Whole, taken: set[int]) -> str:
    left = [number for number in range(len(whole.pieces)) if number not in taken]
    first = min(taken, default=0)
    before = [number for number in left if number < first]
    after = [number for number in left if number > first] if taken else left
    said = f"{len(left):,} of {len(whole.pieces):,} parts were left out; raise max_chars, or read"
    ways = []
    if before:
        ways.append(f"what comes before: {whole.pieces[before[-1]].place.ref}")
    if after:
        ways.append(f"what comes after: {whole.pieces[after[0]].place.ref}")
    return f"{said} {', '.join(ways)}"


def _outward(centre: int, count: int) -> list[int]:
    """All numbers below `count`, the nearest to `centre` first, later before earlier."""
    return sorted(range(count), key=lambda number: (abs(number - centre), number < centre))


def _first(
    opened: OpenTables, short: str, where: str, values: Sequence[Any]
) -> dict[str, Any] | None:
    for one in opened.ranked(short):
        if rows := opened.rows(f"FROM {one.full} WHERE {where}", values).to_pylist():
            return dict(rows[0])
    return None


def _video(opened: OpenTables, place: SourceLocation) -> Whole:
    row = _first(opened, "youtube_videos", "video_id = ?", [place.key])
    if row is None:
        raise UsageError(f"no video {place.key[:40]!r} here", hint="`search` gives refs")
    url = f"{_WATCH}{place.key}"
    licence = row.get("license") or "none given"
    date = row["published_at"].date() if row.get("published_at") else "no date"
    title = plain(row.get("title")) or place.key
    pieces = []
    if described := plain(row.get("description")).strip():
        pieces.append(Piece(SourceLocation("youtube", place.key), "description", url, described))
    said = _said_in(opened, place.key)
    for begin, after in said.windows():
        text = " ".join(said.texts[begin:after])
        second = int(said.starts[begin])
        at = SourceLocation("youtube", place.key, str(second))
        pieces.append(Piece(at, f"{_clock(second)} transcript", f"{url}&t={second}s", text))
    if not pieces:
        pieces.append(Piece(SourceLocation("youtube", place.key), "no transcript is here", url, ""))
    asked = _number(place.at)
    starts = [number for number, one in enumerate(pieces) if _number(one.place.at) <= asked]
    centre = max(starts, default=0) if place.at else 0
    facts = f"youtube video · {date} · licence {licence} · {url}"
    return Whole(facts, title, pieces, _outward(centre, len(pieces)))


def _said_in(opened: OpenTables, key: str) -> Talk:
    row = _first(opened, "youtube_transcripts", "video_id = ?", [key]) or {}
    cues = row.get("cues") or ()
    return talk(*([one[name] for one in cues] for name in ("start_s", "duration_s", "text")))


def _number(at: str) -> float:
    try:
        return float(at or -1)
    except ValueError:
        raise UsageError(f"{at[:40]!r} is no second", hint="write it like 61") from None


def _clock(second: int) -> str:
    return f"{second // 3600}:{second // 60 % 60:02}:{second % 60:02}"


def _page(opened: OpenTables, place: SourceLocation) -> Whole:
    by_key = place.key.isdecimal() and len(place.key) < 19
    if by_key:
        row = _first(opened, "wiki_pages", "page_id = ?", [int(place.key)])
    else:
        row = _first(opened, "wiki_pages", "url = ? OR title = ?", [place.key] * 2)
    if row is None:
        raise UsageError(f"no page {place.key[:200]!r} here", hint="`search` gives refs")
    key = row["page_id"]

    def rows(short: str, order: str) -> list[dict[str, Any]]:
        for one in opened.ranked(f"wiki_{short}"):
            sql = f"FROM {one.full} WHERE page_id = ? ORDER BY {order}"
            return opened.rows(sql, [key]).to_pylist()
        return []

    tables = grid(rows("cells", "table_id, row_index, column_index"))
    alts = {one["element_id"]: plain(one["alt_text"]).strip() for one in rows("images", "ALL")}
    pieces: list[Piece] = []
    centre = -1
    for section in sections(rows("elements", "reading_order"), tables, alts):
        lines = [
            *section.lines,
            *("\n".join(table) for table in section.tables),
            *(f"(image: {alt})" for alt in section.alts),
        ]
        if not lines and not section.anchor:
            continue
        url = link(row["url"], row["revision_id"], section.anchor)
        at = url.partition("#")[2]
        if centre < 0 and anchor(at) == anchor(place.at):
            centre = len(pieces)
        text = "\n\n".join([*([section.path] if section.path else []), *lines])
        label = "section" if section.anchor else "top of the page"
        pieces.append(Piece(SourceLocation("wiki", str(key), at), label, url, text))
    if centre < 0 and place.at:
        raise UsageError(
            f"the page {key} has no section {anchor(place.at)[:200]!r}",
            hint=f"read wiki:{key} for its beginning; it may have been another revision's",
        )
    url = link(row["url"], row["revision_id"], "")
    facts = (
        f"wiki page · {row['revision_timestamp'].date()} · {revision(url)} ·"
        f" licence {row.get('license') or 'none given'} · {url}"
    )
    return Whole(facts, plain(row["title"]), pieces, _outward(max(centre, 0), len(pieces)))


def _thread(opened: OpenTables, place: SourceLocation) -> Whole:
    if place.key.startswith("t1_"):
        row = _first(opened, "reddit_comments", "comment_id = ?", [place.key[3:]])
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
    nearest = list(dict.fromkeys([*first, *_outward(centre, len(pieces))]))
    date = thread.post["created_utc"].date()
    facts = f"reddit thread · {date} · no licence given, texts are their authors' · {url}"
    return Whole(facts, plain(thread.title) or key, pieces, nearest)


def _said(text: str | None, missing: str | None) -> str:
    return plain(text) if text is not None else f"[{missing or 'the text is not here'}]"


_READ: dict[str, Callable[[OpenTables, SourceLocation], Whole]] = {
    "youtube": _video,
    "wiki": _page,
    "reddit": _thread,
}
