"""What `read` shows of a video: its description and the windows of its transcript."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import SplitResult

from kb.core.errors import UsageError
from kb.mcp.around import Piece, Whole, first_row, outward
from kb.mcp.places import SourceLocation
from kb.reader.opened import OpenTables
from kb.search.passage import plain
from kb.search.transcripts import Talk, talk

_WATCH = "https://www.youtube.com/watch?v="


def of_link(url: SplitResult, query: Mapping[str, list[str]]) -> SourceLocation | None:
    """The second of a video that a watch page's URL names."""
    if not query.get("v"):
        return None
    return SourceLocation("youtube", query["v"][0], query.get("t", [""])[0].removesuffix("s"))


def around(opened: OpenTables, place: SourceLocation) -> Whole:
    row = first_row(opened, "youtube_videos", "video_id = ?", [place.key])
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
    return Whole(facts, title, pieces, outward(centre, len(pieces)))


def _said_in(opened: OpenTables, key: str) -> Talk:
    row = first_row(opened, "youtube_transcripts", "video_id = ?", [key]) or {}
    cues = row.get("cues") or ()
    return talk(*([one[name] for one in cues] for name in ("start_s", "duration_s", "text")))


def _number(at: str) -> float:
    try:
        return float(at or -1)
    except ValueError:
        raise UsageError(f"{at[:40]!r} is no second", hint="write it like 61") from None


def _clock(second: int) -> str:
    return f"{second // 3600}:{second // 60 % 60:02}:{second % 60:02}"
