"""`kb index`: clean rows of a source to index/<source>.sqlite.

Two tables that any SQLite opens, datasette included: `passages`, and `found`, its words by FTS5.
The file is written anew and takes the old one's place whole, so no page of it ever held anything
else; it is made again where clean/ or the rules are others than noted beside it (kb.store.indexed).
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import orjson

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.profile import Profile
from kb.core.progress import Task
from kb.core.sources import SOURCES
from kb.core.verdict import Summary
from kb.search import sections, threads, transcripts
from kb.search.passage import MOST_WORDS, Passage
from kb.store import indexed
from kb.store.atomic import writing
from kb.store.indexed import Note
from kb.store.layout import Layout
from kb.store.lock import taking

COLUMNS = ("title", "path", "text", "alt")  # what is searched
_AT_ONCE = 1000  # rows of an insert
_HELD = (
    32 << 20
)  # bytes of words that FTS5 sorts at a time: fewer parts to put together, in half of
# the time and less room
_SCHEMA = """
    PRAGMA journal_mode = OFF;
    PRAGMA synchronous = OFF;
    CREATE TABLE passages (
        id INTEGER PRIMARY KEY, kind TEXT, key TEXT, thing TEXT, title TEXT, path TEXT, text TEXT,
        alt TEXT, url TEXT, date TEXT, licence TEXT, times TEXT
    );
    CREATE VIRTUAL TABLE found USING fts5(
        title, path, text, alt, content = 'passages', content_rowid = 'id', tokenize = '{tokens}'
    );
"""
_INSERT = "INSERT INTO passages VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"


class Made(NamedTuple):
    """A source's index: its passages, and whether it had to be made."""

    passages: int
    fresh: bool


def index(run: Run) -> Summary:
    """Every source's index that does not say what clean/ says.

    Raises FatalError where nothing was filtered yet, WriterLocked, DamagedData, DiskFull.
    """
    made = {source: found for source in SOURCES if (found := follow(run, source)) is not None}
    if not made:
        raise FatalError(
            f"nothing to index: {run.root} has no clean tables",
            hint="run a crawl and its filter first, or `make demo`",
        )
    return Summary(
        command="index",
        passages=sum(one.passages for one in made.values()),
        indexed=sorted(source for source, one in made.items() if one.fresh),
        sources={source: one.passages for source, one in made.items()},
        path=str(Layout(run.root).indexes),
    )


def follow(run: Run, source: str) -> Made | None:
    """Make the source's index again where it has to be, or where the run says `again`.

    None where the source has no clean tables: then no index stays either. Raises as `index`.
    """
    with taking(run.root, f"index-{source}"):
        paths = indexed.files(run.root, source)
        if not paths:
            indexed.forget(run.root, source)
            return None
        rules, note = _rules(run.profile, source), indexed.read(run.root, source)
        now = indexed.stamps(paths, note.files if note else None)
        current = note is not None and note.rules == rules and indexed.same(note.files, now)
        if note and current and not run.again and indexed.is_whole(run.root, source):
            own = indexed.stamp(Layout(run.root).index(source))
            if (note.files, note.own) != (now, own):  # the same bytes, copied
                indexed.write(run.root, source, Note(rules, now, own, note.passages))
            return Made(note.passages, fresh=False)
        with run.progress.task(f"index {source}", unit="passages") as task:
            count = _write(
                Layout(run.root).index(source),
                _READ[source](run.profile)(run.root),
                rules["tokens"],
                task,
            )
        own = indexed.stamp(Layout(run.root).index(source))
        indexed.write(run.root, source, Note(rules, now, own, count))
    return Made(count, fresh=True)


def _write(path: Path, passages: Iterator[Passage], tokens: str, task: Task) -> int:
    count = 0
    with writing(path) as temporary, contextlib.closing(sqlite3.connect(temporary)) as con:
        con.executescript(_SCHEMA.format(tokens=tokens))
        numbered = (_row(number, one) for number, one in enumerate(passages, 1))
        while some := list(islice(numbered, _AT_ONCE)):
            con.executemany(_INSERT, some)
            con.commit()
            count += len(some)
            task.advance(len(some))
        con.execute("INSERT INTO found(found, rank) VALUES ('hashsize', ?)", [_HELD])
        con.execute("INSERT INTO found(found) VALUES ('rebuild')")
        con.execute("INSERT INTO found(found) VALUES ('optimize')")
        con.commit()
    return count


def _row(number: int, one: Passage) -> tuple[Any, ...]:
    times = orjson.dumps(one.times).decode() if one.times else None
    head = number, one.kind, one.key, one.thing, one.title, one.path, one.text
    return *head, one.alt, one.url, one.date, one.licence, times


def _rules(profile: Profile, source: str) -> dict[str, Any]:
    """All that decides what an index holds, besides clean/."""
    english = profile.youtube is None or profile.youtube.language == "en"
    words = "unicode61 remove_diacritics 2"
    return {
        "tokens": f"porter {words}" if english else words,
        "words": [MOST_WORDS, transcripts.MOST, transcripts.LEAST],
        "subreddit": profile.section("reddit").subreddit if source == "reddit" else "",
    }


_READ: dict[str, Callable[[Profile], Callable[[Path], Iterator[Passage]]]] = {
    "youtube": lambda _: transcripts.passages,
    "wiki": lambda _: sections.passages,
    "reddit": lambda profile: partial(threads.passages, profile.section("reddit").subreddit),
}
