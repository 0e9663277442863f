"""What `read` shows of a thread: the post and its comments."""

from kb.core.errors import UsageError
from kb.mcp.documents import AgentDocument, DocumentPart, SourceLocation, first_row, outward
from kb.reader import thread as threads
from kb.reader.tables import OpenTables
from kb.search.passage import plain


def document(tables: OpenTables, place: SourceLocation) -> AgentDocument:
    """The thread of a place. Raises UsageError if the post or comment is unknown."""
    if place.key.startswith("t1_"):
        row = first_row(tables, "reddit_comments", "comment_id = ?", [place.key[3:]])
        if row is None:
            raise UsageError(f"unknown comment {place.key[:40]!r}", hint="`search` returns refs")
        place = SourceLocation("reddit", row["post_id"], row["comment_id"])
    thread = threads.find(tables, place.key)
    key = thread.post_id
    url = f"https://www.reddit.com/comments/{key}/"
    parts = [
        DocumentPart(SourceLocation("reddit", key), "post", url, _text(thread.body, thread.missing))
    ]
    above: list[int] = []
    parents: list[list[int]] = [[]]
    for level, comment in thread.walk():
        del above[level:]
        parents.append([*above])
        above.append(len(parts))
        score = "" if comment.score is None else f", score {comment.score}"
        label = f"comment, level {level + 1}{score}, {comment.created_utc.date()}"
        at = SourceLocation("reddit", key, comment.comment_id)
        text = _text(comment.body, comment.missing)
        parts.append(DocumentPart(at, label, f"{url}_/{comment.comment_id}/", text))
    numbers = {part.place.at: number for number, part in enumerate(parts)}
    if place.at not in numbers:
        raise UsageError(f"post {key} has no comment {place.at[:40]!r}", hint=f"read reddit:{key}")
    centre = numbers[place.at]
    answers = [n for n, chain in enumerate(parents) if centre in chain]
    first = [centre, *reversed(parents[centre]), 0, *answers]
    nearest = list(dict.fromkeys([*first, *outward(centre, len(parts))]))
    date = thread.post["created_utc"].date()
    facts = f"reddit thread · {date} · no licence given, texts are their authors' · {url}"
    return AgentDocument(facts, plain(thread.title) or key, parts, nearest)


def _text(text: str | None, missing: str | None) -> str:
    return plain(text) if text is not None else f"[{missing or 'text not available'}]"
