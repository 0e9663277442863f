"""The best passages of a data root, as answers with a snippet and a link to the very place."""

from __future__ import annotations

import contextlib
import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from kb.core.errors import DamagedData, UsageError
from kb.core.sources import SOURCES
from kb.search.entities import restrict
from kb.search.rank import Only, Ranked, rank, weigh
from kb.search.words import question
from kb.store import indexed, sqlite
from kb.store.layout import Layout

KINDS = ("video", "transcript", "section", "table", "post", "comment")
MARK = "**"  # around the words of a snippet that were asked for
_SNIPPET = 32  # words
_LEFT, _RIGHT = "\x02", "\x03"  # passages have no control characters
_COLUMN = {"title": 0, "path": 1, "text": 2, "alt": 3}
_PASSAGE = ("kind", "key", "title", "path", "text", "alt", "url", "date", "licence", "times")


class Answer(msgspec.Struct):
    """A passage that was asked for. `text` is at most as long as was asked, `snippet` a part of it
    with the words marked; `start_s` where a video speaks of it; `licence` None where the source
    gives none.
    """

    text: str
    snippet: str
    source: str
    kind: str
    key: str
    title: str
    path: str
    score: float
    url: str
    licence: str | None
    date: str | None
    start_s: float | None = None


def search(
    root: Path,
    words: str,
    *,
    sources: Sequence[str] = (),
    only: Only | None = None,
    size: int = 1000,
    entity: str = "",
) -> list[Answer]:
    """The best answers first. `size`: characters of an answer's text at most. `entity`: out of
    videos, pages, posts and comments alone that are linked to it (kb.search.entities).

    No text is a wrong question: without a word in it there are no answers. Raises UsageError where
    a source has no index or one that does not follow clean/, and so for the entity tables where
    they are asked for; DamagedData for what can't be read.
    """
    asked = question(words)
    with contextlib.ExitStack() as stack:
        indexes = {
            source: stack.enter_context(_opened(root, source))
            for source in usable(root, sources or SOURCES)
        }
        weighed = weigh(indexes, asked)
        if entity:
            restrict(root, entity, indexes)
        ranked = rank(indexes, asked, weighed, only or Only(), linked=bool(entity))
        return [_answer(indexes[one.source], one, weighed.marked, size) for one in ranked]


def usable(root: Path, sources: Sequence[str]) -> list[str]:
    """Those of the sources that have clean tables; their index is current.

    Raises UsageError for one whose index is not, and where there are no clean tables.
    """
    with_rows = [source for source in sources if indexed.files(root, source)]
    if not with_rows:
        raise UsageError(
            f"nothing to search: {root} has no clean tables of {' or '.join(sources)}",
            hint="run a crawl and its filter first, or `make demo`",
        )
    for source in with_rows:
        if not indexed.is_current(root, source):
            raise UsageError(
                f"the index of {source} is not there, or older than clean/{source}",
                hint="run `kb index`",
            )
    return with_rows


@contextlib.contextmanager
def _opened(root: Path, source: str) -> Iterator[sqlite.Connection]:
    path = Layout(root).index(source)
    try:
        with contextlib.closing(sqlite.connect(path, readonly=True)) as con:
            yield con
    except DamagedData as error:
        if str(path) not in str(error):
            raise  # another one's
        raise DamagedData(f"{path} can't be read", hint="run `kb index --again`") from None


def _answer(con: sqlite.Connection, ranked: Ranked, marked: str, size: int) -> Answer:
    sql = f"SELECT {', '.join(_PASSAGE)} FROM passages WHERE id = ?"
    row: dict[str, Any] = dict(zip(_PASSAGE, con.execute(sql, [ranked.id]).fetchone(), strict=True))
    snippet, column = "", ""
    for column in ("text", "alt", "path", "title"):
        snippet = _snippet(con, ranked.id, marked, column)
        if _LEFT in snippet:
            break
    start = _second(row, snippet) if column == "text" else None
    url = row["url"]
    if start is not None:
        url = re.sub(r"&t=\d+s$", f"&t={int(start)}s", url)
    return Answer(
        text=cut(row["text"] or row["alt"] or row["title"], size),
        snippet=snippet.replace(_LEFT, MARK).replace(_RIGHT, MARK),
        source=ranked.source,
        kind=row["kind"],
        key=row["key"],
        title=row["title"],
        path=row["path"],
        score=ranked.score,
        url=url,
        licence=row["licence"],
        date=row["date"],
        start_s=start if start is not None else _first(row),
    )


def cut(text: str, size: int) -> str:
    """The text, or as much of it as `size` characters hold with an ellipsis."""
    return text if len(text) <= size else text[: max(0, size - 1)].rstrip() + "…"


def _snippet(con: sqlite.Connection, number: int, marked: str, column: str) -> str:
    sql = (
        f"SELECT snippet(found, {_COLUMN[column]}, ?, ?, '…', {_SNIPPET}) FROM found"
        " WHERE found MATCH ? AND rowid = ?"
    )
    found = con.execute(sql, [_LEFT, _RIGHT, marked, number]).fetchone()
    return " ".join(str(found[0]).split()) if found and found[0] else ""


def _second(row: dict[str, Any], snippet: str) -> float | None:
    """The second at which the cue with the most of the snippet's marked words begins, of several
    the first.
    """
    if not row["times"] or _LEFT not in snippet:
        return None
    times: list[tuple[int, float]] = json.loads(row["times"])
    at: int = row["text"].find(snippet.replace(_LEFT, "").replace(_RIGHT, "").strip("…"))
    if at < 0:
        return None
    marks: Counter[float] = Counter()
    for piece in re.split(f"({_LEFT}[^{_RIGHT}]*{_RIGHT})", snippet.strip("…")):
        bare = piece.strip(_LEFT + _RIGHT)
        if piece.startswith(_LEFT):
            marks[max(second for first, second in times if first <= at)] += len(bare.split())
        at += len(bare)
    return min(marks, key=lambda second: (-marks[second], second))


def _first(row: dict[str, Any]) -> float | None:
    return float(json.loads(row["times"])[0][1]) if row["times"] else None
