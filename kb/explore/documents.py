"""The page of one video, wiki page or thread, kept or not, with the place that led to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

from kb.artifacts import index
from kb.artifacts.stored_files import stored_file
from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.explore.pairs import PairCard, cards
from kb.explore.rows import cell
from kb.explore.tables import CurrentTables
from kb.look.headings import heading
from kb.mcp.documents import (
    AgentDocument,
    Readers,
    SourceLocation,
    first_row,
    outward,
    parse_reference,
    surroundings,
)
from kb.reader import thread as threads
from kb.reader.tables import OpenTables
from kb.schema import table
from kb.search.passage import plain
from kb.search.query import function_words, question
from kb.search.tantivy_index import analyzer
from kb.store.layout import VERDICTS

NEAREST = 40  # parts around the place
_MOST_NODES = 200  # of a thread
_DEEPEST = 8  # levels that are told apart by their indent
Pieces = list[str]
"""A text in pieces, of which every second one is marked."""
Marker = Callable[[str], Pieces]


class Verdict(NamedTuple):
    """Why an item was not kept: its verdict ("rejected"), and (heading, value) of what decided."""

    name: str
    facts: list[tuple[str, str]]

    @property
    def line(self) -> str:
        """The same in a few words."""
        return ", ".join(value for _, value in self.facts if value)


@dataclass
class ThreadNode:
    """A post or comment, at its level in the tree. `parent`: the full name of what it answers;
    `why` it was not kept, "" where it was.
    """

    key: str
    label: str
    url: str
    pieces: Pieces
    parent: str | None = None
    level: int = 0
    why: str = ""


@dataclass
class DocumentPage:
    """A document. `kind` is video, page, thread, or none where only a verdict is known.

    `shown` are the numbers of the parts that the page has, `here` that of the place; `all` is the
    address of the page with every part, "" where it has all. `around_caption` is the text at `here`
    of a video in three parts: before the caption of the second asked for, that, and behind it.
    """

    kind: str
    title: str
    ref: str
    address: str
    facts: list[tuple[str, str]]
    verdict: Verdict | None = None
    document: AgentDocument | None = None
    here: int = 0
    shown: list[int] = field(default_factory=list)
    all: str = ""
    around_caption: tuple[str, str, str] = ("", "", "")
    pairs: list[PairCard] = field(default_factory=list)
    nodes: list[ThreadNode] = field(default_factory=list)
    text: Pieces = field(default_factory=list)
    mark: Marker = lambda text: [text]


def read(root: Path, language: str, query: Mapping[str, str], readers: Readers) -> DocumentPage:
    """What stands around the place that an address names; `language` as for pairs.

    Raises UsageError, DamagedData.
    """
    place = parse_reference(query.get("ref", ""))
    tables = CurrentTables(root)
    mark = _marker(root, place.source, query.get("words", ""))
    every = {**{name: query[name] for name in ("ref", "words") if query.get(name)}, "all": "1"}
    page = DocumentPage("", "", place.ref, "", [], all=f"?{urlencode(every)}#here", mark=mark)
    every_part = bool(query.get("all"))
    shape = SOURCES[place.source].shape
    if shape == "thread":
        return _thread(tables, place, page, mark, every_part)
    try:
        found = _kept(tables, place, page, every_part, readers)
    except UsageError:
        verdict = _verdict(tables, place.source, place.key)
        if verdict is None:
            raise
        return _left_out(place, page, mark, *verdict)
    if shape == "video":
        found.pairs = cards(tables, language, "video_id = ?", [place.key])
    return found


def _kept(
    tables: CurrentTables,
    place: SourceLocation,
    page: DocumentPage,
    every_part: bool,
    readers: Readers,
) -> DocumentPage:
    """A video with its transcript, a wiki page with its sections, or another item's parts."""
    opened = OpenTables([tables.catalog])
    page.document = document = readers[place.source].document(opened, place)
    of = SOURCES[place.source]
    page.kind, page.title, page.here = of.shape or "text", document.title, document.nearest[0]
    page.shown = sorted(document.nearest[: len(document.parts) if every_part else NEAREST])
    page.all = "" if len(page.shown) == len(document.parts) else page.all
    key = document.parts[0].place.key
    column = table(f"{of.name}/{of.main}").key[0]
    row = first_row(opened, f"{of.name}_{of.main}", f"{column}::VARCHAR = ?", [key]) or {}
    page.facts = _facts(place.source, row)
    page.address = document.parts[0].url
    if page.kind == "video" and place.at:
        page.around_caption = _around_caption(
            opened, of.name, key, document.parts[page.here].text, float(place.at)
        )
    return page


def _around_caption(
    opened: OpenTables, source: str, key: str, text: str, second: float
) -> tuple[str, str, str]:
    """The text of a part before the caption of a second, the caption, and the text behind it."""
    row = first_row(opened, f"{source}_transcripts", "video_id = ?", [key]) or {}
    cues = [cue for cue in row.get("cues") or () if int(cue["start_s"]) <= second]
    caption = " ".join(plain(cues[-1]["text"]).split()) if cues else ""
    if not caption or caption not in text:
        return text, "", ""
    return text.partition(caption)


def _facts(source: str, row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(heading, value) of the columns of a main row that have one."""
    declared = f"{source}/{SOURCES[source].main}"
    return [
        (heading(declared, name), cell(declared, name, row[name]).text)
        for name in SOURCES[source].facts
        if row.get(name) is not None
    ]


def _verdict(tables: CurrentTables, source: str, key: str) -> tuple[Verdict, dict[str, Any]] | None:
    """Why an item was not kept, and its row of shared/<verdict>; None for any other item."""
    names = [name for name in VERDICTS if f"{source}_{name}" in tables]
    with tables.asked(*(f"{source}_{name}" for name in names)) as con:
        for name in names:
            sql = f"FROM {tables.view(f'{source}_{name}').full} WHERE key = ? LIMIT 1"
            for row in con.sql(sql, params=[key]).to_arrow_table().to_pylist():
                return _verdict_of(name, row), row
    return None


def _verdict_of(name: str, row: Mapping[str, Any]) -> Verdict:
    declared = f"shared/{name}"
    shown = ("stage", "reason", "value", "threshold", "matched", "unmatched")
    return Verdict(
        name,
        [
            (heading(declared, column), cell(declared, column, row[column]).text)
            for column in shown
            if row.get(column) is not None
        ],
    )


def _left_out(
    place: SourceLocation, page: DocumentPage, mark: Marker, verdict: Verdict, row: dict[str, Any]
) -> DocumentPage:
    """A video or wiki page that was not kept, as far as its row tells."""
    page.verdict, page.all = verdict, ""
    page.title = row.get("title") or place.key
    page.address = SOURCES[place.source].url_of(place.key) if page.kind != "thread" else ""
    page.text = mark(row["text"]) if row.get("text") else []
    channel = row.get("channel_title")
    page.facts = [("Channel title", channel)] if channel else []
    return page


def _thread(
    tables: CurrentTables, place: SourceLocation, page: DocumentPage, mark: Marker, every_part: bool
) -> DocumentPage:
    """A post with all its comments, those that were not kept among them, as a tree."""
    page.kind, opened = "thread", OpenTables([tables.catalog])
    post_id, comment_id = place.key, place.at
    if place.key.startswith("t1_"):
        post_id, comment_id = _post_of(tables, opened, place.source, place.key), place.key[3:]
        if not post_id:
            verdict = _verdict(tables, place.source, place.key)
            if verdict is None:
                raise UsageError(f"unknown comment {place.key[:40]!r}", hint="Rows lists them")
            return _left_out(place, page, mark, *verdict)
    page.address, page.title = SOURCES[place.source].url_of(post_id), f"Post {post_id}"
    rejected = _rejected_comments(tables, place.source, post_id)
    post, kept = _post_and_comments(
        tables, opened, page, place.source, post_id, mark, required=not rejected
    )
    comments = kept | {row["key"]: _rejected_comment(page.address, row, mark) for row in rejected}
    parents = {name: node.parent for name, node in comments.items()}
    order = threads.reading_order(parents, f"t3_{post_id}")
    page.nodes = [
        post,
        *(replace(comments[name], level=min(level + 1, _DEEPEST)) for level, name in order),
    ]
    keys = [node.key for node in page.nodes]
    if comment_id not in keys:
        raise UsageError(
            f"post {post_id} has no comment {comment_id[:40]!r}",
            hint=f"open {place.source}:{post_id}",
        )
    page.here = keys.index(comment_id)
    nearest = outward(page.here, len(keys))
    page.shown = sorted({0, *(nearest if every_part else nearest[:_MOST_NODES])})
    page.all = "" if len(page.shown) == len(keys) else page.all
    return page


def _post_and_comments(
    tables: CurrentTables,
    opened: OpenTables,
    page: DocumentPage,
    source: str,
    post_id: str,
    mark: Marker,
    *,
    required: bool,
) -> tuple[ThreadNode, dict[str, ThreadNode]]:
    """The post and its kept comments by full name; a post that was not kept has no comments. Sets
    the page's title, facts and verdict.
    """
    if (verdict := _verdict(tables, source, f"t3_{post_id}")) is not None:
        page.verdict, row = verdict
        page.title = row.get("title") or page.title
        text, why = mark(row.get("text") or ""), page.verdict.line
        return ThreadNode("", "post", page.address, text, why=why), {}
    thread = _thread_of(opened, post_id, required=required)
    if thread is None:
        why = "unknown: no service returned it"
        return ThreadNode("", "post", page.address, [], why=why), {}
    page.title = thread.title or page.title
    page.facts = _facts(source, thread.post)
    post = ThreadNode("", "post", page.address, mark(_words(thread.body, thread.missing)))
    return post, {
        f"t1_{comment.comment_id}": _kept_comment(page.address, comment, mark)
        for _, comment in thread.walk()
    }


def _thread_of(opened: OpenTables, post_id: str, *, required: bool) -> threads.Thread | None:
    """A post that no filter rejected, with its kept comments; None where no service returned it.
    Raises UsageError for that where it is `required`.
    """
    try:
        return threads.find(opened, post_id)
    except UsageError:
        if required:
            raise
        return None


def _kept_comment(post_url: str, comment: threads.ThreadComment, mark: Marker) -> ThreadNode:
    score = "" if comment.score is None else f", score {comment.score:,}"
    return ThreadNode(
        comment.comment_id,
        f"comment, {comment.created_utc:%Y-%m-%d}{score}",
        f"{post_url}_/{comment.comment_id}/",
        mark(_words(comment.body, comment.missing)),
        comment.parent_id,
    )


def _rejected_comment(post_url: str, row: Mapping[str, Any], mark: Marker) -> ThreadNode:
    comment_id, text = row["key"][3:], mark(row.get("text") or "")
    why = _verdict_of("rejected", row).line
    url = f"{post_url}_/{comment_id}/"
    return ThreadNode(comment_id, "comment", url, text, row["parent_id"], why=why)


def _post_of(tables: CurrentTables, opened: OpenTables, source: str, fullname: str) -> str:
    """The post of a comment, kept or not; "" where nothing tells it."""
    row = first_row(opened, f"{source}_comments", "comment_id = ?", [fullname[3:]])
    if row is None and _keeps_words(tables, source):
        sql = "SELECT post_id FROM {table} WHERE key = ? AND post_id IS NOT NULL"
        row = next(iter(tables.rows(f"{source}_rejected", sql, [fullname]).to_pylist()), None)
    return str(row["post_id"]) if row else ""


def _keeps_words(tables: CurrentTables, source: str) -> bool:
    """Whether rejected comments say what they were; an older filter's do not."""
    name = f"{source}_rejected"
    return name in tables and "post_id" in tables.columns(name)


def _rejected_comments(tables: CurrentTables, source: str, post_id: str) -> list[dict[str, Any]]:
    if not _keeps_words(tables, source):
        return []
    sql = (
        "SELECT key, parent_id, text, stage::VARCHAR AS stage, reason::VARCHAR AS reason"
        " FROM {table} WHERE post_id = ? ORDER BY length(key), key"
    )
    return tables.rows(f"{source}_rejected", sql, [post_id]).to_pylist()


def _words(text: str | None, missing: str | None) -> str:
    return text if text is not None else f"[{missing}]" if missing else ""


def screenshot(root: Path, query: Mapping[str, str], readers: Readers) -> bytes:
    """The PNG of the page that an address names. Raises UsageError, DamagedData."""
    shown = surroundings(root, parse_reference(query.get("ref", "")), readers).screenshot
    if shown is None:
        raise UsageError("the page has no screenshot")
    return stored_file(shown.home, shown.path)[0]


def _marker(root: Path, source: str, words: str) -> Marker:
    """What marks the words of a search as the search itself finds them."""
    if not words.strip():
        return lambda text: [text]
    known = index.known(root, source)
    language = str(known.figures["language"]) if known is not None else ""
    split, small = analyzer(language), function_words(language)
    try:
        terms = question(words, small.__contains__).terms
    except UsageError:
        return lambda text: [text]
    stems = {stem for term in terms for stem in split.analyze(term.text)}
    begun = tuple(split.analyze(term.text)[-1] for term in terms if term.prefix)

    def mark(text: str) -> Pieces:
        pieces, at = [], 0
        for token in split.pre_tokenize(text).tokens:
            if token.text in stems or (begun and token.text.startswith(begun)):
                start, end = token.char_offset_from, token.char_offset_to
                pieces += [text[at:start], text[start:end]]
                at = end
        return [*pieces, text[at:]]

    return mark
