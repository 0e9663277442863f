"""`read`: what stands around a place, taken from the clean tables (or what was restored).

Pieces come in their own order: windows of a transcript, sections of a page with their tables, a
post and its comments. The place's own piece is taken first, then those nearest to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.artifacts import catalog
from kb.core.errors import UsageError
from kb.core.sources import SPECS
from kb.mcp.fence import Fence, Unit
from kb.mcp.places import SourceLocation
from kb.reader.opened import OpenTables


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
    agent = SPECS[place.source].agent
    if agent is None:
        raise UsageError(f"nothing is read around places of {place.source}", hint="use `query`")
    whole: Whole = SPECS[place.source].load(agent.reader)(opened, place)
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


def outward(centre: int, count: int) -> list[int]:
    """All numbers below `count`, the nearest to `centre` first, later before earlier."""
    return sorted(range(count), key=lambda number: (abs(number - centre), number < centre))


def first_row(
    opened: OpenTables, short: str, where: str, values: Sequence[Any]
) -> dict[str, Any] | None:
    for one in opened.ranked(short):
        if rows := opened.rows(f"FROM {one.full} WHERE {where}", values).to_pylist():
            return dict(rows[0])
    return None
