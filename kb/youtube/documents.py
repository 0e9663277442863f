"""What `read` shows of a video: its description and its transcript in windows."""

from kb.core.errors import UsageError
from kb.mcp.documents import AgentDocument, DocumentPart, SourceLocation, first_row, outward
from kb.reader.tables import OpenTables
from kb.search.passage import plain
from kb.youtube.passages import talk

_WATCH = "https://www.youtube.com/watch?v="


def document(tables: OpenTables, place: SourceLocation) -> AgentDocument:
    """The video of a place. Raises UsageError if it is unknown."""
    row = first_row(tables, "youtube_videos", "video_id = ?", [place.key])
    if row is None:
        raise UsageError(f"unknown video {place.key[:40]!r}", hint="`search` returns refs")
    url = f"{_WATCH}{place.key}"
    licence = row.get("license") or "none given"
    date = row["published_at"].date() if row.get("published_at") else "no date"
    title = plain(row.get("title")) or place.key
    parts = []
    if described := plain(row.get("description")).strip():
        parts.append(
            DocumentPart(SourceLocation("youtube", place.key), "description", url, described)
        )
    spoken = first_row(tables, "youtube_transcripts", "video_id = ?", [place.key]) or {}
    cues = spoken.get("cues") or ()
    transcript = talk(*([one[name] for one in cues] for name in ("start_s", "duration_s", "text")))
    for begin, end in transcript.windows():
        text = " ".join(transcript.texts[begin:end])
        second = int(transcript.starts[begin])
        at = SourceLocation("youtube", place.key, str(second))
        clock = f"{second // 3600}:{second // 60 % 60:02}:{second % 60:02}"
        parts.append(DocumentPart(at, f"{clock} transcript", f"{url}&t={second}s", text))
    if not parts:
        parts.append(
            DocumentPart(SourceLocation("youtube", place.key), "no transcript available", url, "")
        )
    wanted = _number(place.at)
    starts = [number for number, one in enumerate(parts) if _number(one.place.at) <= wanted]
    centre = max(starts, default=0) if place.at else 0
    facts = f"youtube video · {date} · licence {licence} · {url}"
    return AgentDocument(facts, title, parts, outward(centre, len(parts)))


def _number(at: str) -> float:
    try:
        return float(at or -1)
    except ValueError:
        raise UsageError(f"invalid second {at[:40]!r}", hint="give a number, such as 61") from None
