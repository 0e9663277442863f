"""The best passages of a data root, as answers with a snippet and a link to the very place."""

import re
from collections import Counter
from collections.abc import Sequence
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
from tantivy import TextAnalyzer

from kb.artifacts import index, manifest, texts
from kb.artifacts.table_catalog import NO_TABLES, Catalog
from kb.core.errors import UsageError
from kb.core.search_hit import SearchHit, cut
from kb.core.sources import SOURCES
from kb.core.suggestions import similar
from kb.search.passage import Passage
from kb.search.query import clean
from kb.search.ranking import IndexedTerm, Only, Ranked, Weights, rank, understood
from kb.search.tantivy_index import PassageIndex
from kb.store.layout import Layout
from kb.store.tables import parquet
from kb.store.tables.checksums import library_path
from kb.store.tables.reading import reading

MARK = "**"  # around matching words
MOST = 32  # words
_KNOWN = 50_000  # most frequent words with the same first letter that are compared
_LEAST = 0.7  # similarity (difflib's ratio) of a word to one that is suggested for it
_COMPARED = 20  # nearest words of which the most frequent is chosen
_AS_NEAR = 0.05  # of such a similarity: within that the more frequent word is taken
_READ = 20  # passages in which the spelling of a stem is looked up


class NotIndexed(UsageError):
    """There are no texts to search, or their index is missing or out of date."""


def search(
    root: Path,
    words: str,
    *,
    sources: Sequence[str] = (),
    only: Only | None = None,
    size: int = 1000,
    entity: str = "",
) -> list[SearchHit]:
    """The best answers first. `size`: characters of an answer's text at most. `entity`: only
    among the videos, pages, posts and comments that are linked to it.

    Raises UsageError for a query without a word to look for, and where the entity tables are asked
    for and don't follow clean/; NotIndexed where an index does not; DamagedData for what can't be
    read.
    """
    indexes = {source: _opened(root, source) for source in usable(root, sources or tuple(SOURCES))}
    asked = understood(indexes, words)
    weights = Weights(indexes, asked)
    linked = restrict(root, entity, list(indexes)) if entity else None
    return [
        _answer(indexes[ranked.source], ranked, weights.marked(ranked.source), size)
        for ranked in rank(indexes, asked, weights, only or Only(), linked)
    ]


class Meant(NamedTuple):
    """`suggestion`: a nearer spelling of the words, "" for none; `instead`: as nothing has the
    words themselves, these are the answers to it.
    """

    answers: list[SearchHit]
    suggestion: str
    instead: bool


def search_as_meant(root: Path, words: str, *, sources: Sequence[str] = (), **asked: Any) -> Meant:
    """The best answers; where there are none those to the suggestion. Raises as `search`."""
    answers = search(root, words, sources=sources, **asked)
    suggestion = suggest(root, words, sources=sources)
    if answers or not suggestion:
        return Meant(answers, suggestion, instead=False)
    return Meant(search(root, suggestion, sources=sources, **asked), suggestion, instead=True)


def suggest(root: Path, words: str, *, sources: Sequence[str] = ()) -> str:
    """The query with each word that no passage has in its nearest spelling that some have; "" where
    every word is known, one has nothing near, or that has no answers either. The first letter of a
    word is taken as typed; what only asks ("how do I make") is left as it is. Raises as `search`.
    """
    indexes = {source: _opened(root, source) for source in usable(root, sources or tuple(SOURCES))}
    text, asked = clean(words), understood(indexes, words)
    for word in {
        word
        for term in asked.terms
        if not term.prefix
        for word in term.text.split()
        if not asked.is_asking(word)
    }:
        known = any(
            min(map(opened.frequency, opened.analyzer.analyze(word)), default=1)
            for opened in indexes.values()
        )
        if not known:
            if not (other := _nearest([*indexes.values()], word)):
                return ""
            text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", other, text)
    if text == clean(words):
        return ""
    asked = understood(indexes, text)
    return text if rank(indexes, asked, Weights(indexes, asked), Only(limit=1)) else ""


def _nearest(indexes: Sequence[PassageIndex], word: str) -> str:
    """The word of a passage that is most like a given one, "" where none is."""
    frequencies: Counter[str] = Counter()
    stem = "".join(indexes[0].analyzer.analyze(word))
    for opened in indexes:
        frequencies.update(dict(opened.frequencies(stem[:1], _KNOWN)))
    near = get_close_matches(stem, frequencies, n=_COMPARED, cutoff=_LEAST)
    if not near:
        return ""
    least = _likeness(near[0], stem) - _AS_NEAR
    best = [other for other in near if _likeness(other, stem) >= least]
    return _spelling(indexes, min(best, key=lambda stem: (-frequencies[stem], stem)), word)


def _likeness(word: str, other: str) -> float:
    return SequenceMatcher(None, word, other).ratio()


def _spelling(indexes: Sequence[PassageIndex], stem: str, word: str) -> str:
    """The word with this stem, in the first passages that have one, that is most like `word`."""
    spellings: Counter[str] = Counter()
    for opened in indexes:
        for passage in opened.first(opened.phrase([stem]), _READ):
            text = f"{passage.title} {passage.path} {passage.text} {passage.alt}".lower()
            spellings.update(
                text[token.char_offset_from : token.char_offset_to]
                for token in opened.analyzer.pre_tokenize(text).tokens
                if token.text == stem
            )
    return min(
        spellings,
        key=lambda spelling: (-_likeness(spelling, word.lower()), -spellings[spelling], spelling),
        default="",
    )


def usable(root: Path, sources: Sequence[str]) -> list[str]:
    """Those of the sources that have texts here; their index is current.

    Raises NotIndexed for one whose index is not, and where there are no texts.
    """
    catalog = Catalog(root.absolute())
    with_rows = [source for source in sources if texts.files(root, f"index/{source}", catalog)]
    if not with_rows:
        raise NotIndexed(
            f"nothing to search: {root} has no texts of {' or '.join(sources)}",
            hint=f"`kb restore` brings back a release's texts; for a data root {NO_TABLES}",
        )
    for source in with_rows:
        if not index.is_current(root, source, catalog):
            raise NotIndexed(
                f"the index of {source} is missing or out of date",
                hint="run `kb index`",
            )
    return with_rows


def _opened(root: Path, source: str) -> PassageIndex:
    index.verify_index(root, source)
    known = index.known(root, source)
    language = str(known.figures["language"]) if known is not None else ""
    return PassageIndex(index.folder(root, source), language)


def _answer(
    index: PassageIndex, ranked: Ranked, marked: Sequence[IndexedTerm], size: int
) -> SearchHit:
    passage = index.passage(ranked.address)
    shown, marks = snippet(passage.text, index.analyzer, marked)
    if not marks and passage.alt:
        alt, of_alt = snippet(passage.alt, index.analyzer, marked)
        if of_alt or not passage.text:
            shown, marks = alt, of_alt
    if not (passage.text or passage.alt):
        shown, marks = snippet(passage.title, index.analyzer, marked)
    start, url = None, passage.url
    if passage.times:
        start = _second(passage, marks)
        url = re.sub(r"&t=\d+s$", f"&t={int(start)}s", url)
    text = passage.text.replace("\n", " ") if passage.times else passage.text
    return SearchHit(
        text=cut(text or passage.alt or passage.title, size),
        snippet=shown,
        source=ranked.source,
        kind=passage.kind,
        key=passage.key,
        title=passage.title,
        path=passage.path,
        score=ranked.score,
        url=url,
        licence=passage.licence,
        date=passage.date,
        start_s=start,
    )


def _second(passage: Passage, marks: Sequence[tuple[int, int]]) -> float:
    """The second at which the cue with the most of the marked words begins, of several the first;
    cues are lines.
    """
    words: Counter[int] = Counter()
    for at, count in marks:
        words[passage.text.count("\n", 0, at)] += count
    return passage.times[min(words, key=lambda line: (-words[line], line), default=0)]


def restrict(root: Path, name: str, sources: Sequence[str]) -> dict[str, list[str]]:
    """The keys that are linked to an entity, for `kb.search.ranking.rank`.

    Raises UsageError where there are no entity tables, they are older than the clean tables that
    are searched, or no entity has that name; DamagedData.
    """
    workplace = Catalog(root.absolute()).workplace
    if manifest.read_manifest(workplace, "links") is not None:
        manifest.check_complete(workplace, "links")
        if stale := [source for source in texts.changed(root, "links") if source in sources]:
            raise UsageError(
                f"the entity tables in {Layout(workplace).links} are older than the texts of"
                f" {stale[0]}",
                hint="run `kb links`",
            )
    elif not Catalog(root.absolute()).files("links/entities"):
        raise UsageError(f"there are no entity tables in {root}", hint="run `kb links` first")
    return keys(root, entity(root, name), sources)


def entity(root: Path, name: str) -> str:
    """The entity of that name, or whose other form it is. Raises UsageError with the nearest."""
    wanted = " ".join(name.split()).casefold()
    rows: list[dict[str, Any]] = []
    files = Catalog(root.absolute()).files("links/entities")
    with reading(files):
        for path in files:
            rows += parquet.read_table(path, columns=["entity", "aliases"]).to_pylist()
    names = {str(row["entity"]).casefold(): str(row["entity"]) for row in rows}
    forms = {alias: str(row["entity"]) for row in rows for alias in row["aliases"]}
    if match := names.get(wanted) or forms.get(wanted):
        return match
    near = similar(wanted, [*names, *forms])
    listed = dict.fromkeys(names.get(word) or forms[word] for word in near)
    hint = f"did you mean {' or '.join(listed)}?" if listed else ""
    lists = '`kb query "SELECT entity FROM links.entities"` lists them'
    raise UsageError(f"no entity {name!r}", hint=hint or lists)


def keys(root: Path, name: str, sources: Sequence[str]) -> dict[str, list[str]]:
    """The keys that are linked to an entity, sorted."""
    linked: dict[str, set[str]] = {source: set() for source in sources}
    files = Catalog(root.absolute()).files("links/links")
    with reading(files):
        parquet.verify_files(*files)
        rows = pq.read_table(
            [library_path(path) for path in files],
            columns=["source", "key"],
            filters=[("entity", "=", name)],
            page_checksum_verification=True,
        )
    for row in rows.to_pylist():
        if row["source"] in linked:
            linked[row["source"]].add(row["key"])
    return {source: sorted(linked_keys) for source, linked_keys in linked.items()}


def snippet(
    text: str, analyzer: TextAnalyzer, marked: Sequence[IndexedTerm]
) -> tuple[str, list[tuple[int, int]]]:
    """A part of a text in one line, "…" where more stands, and (first character, words) in the text
    of what is marked in it.

    It has the MOST words with the longest of the terms, then with the most different ones, then
    with the most marks, then the first; without any the beginning.
    """
    tokens = analyzer.pre_tokenize(text).tokens
    words = [token.text for token in tokens]
    spans = _spans(words, marked)
    begin = _begin(spans, len(words))
    end = min(begin + MOST, len(words))
    shown = [(first, after) for first, after, _ in spans if begin <= first and after <= end]
    at = tokens[begin].char_offset_from if begin else 0
    last = tokens[end - 1].char_offset_to if end < len(words) else len(text)
    assert last is not None
    parts = []
    for first, after in shown:
        start, stop = tokens[first].char_offset_from, tokens[after - 1].char_offset_to
        assert stop is not None
        parts += [text[at:start], MARK, text[start:stop], MARK]
        at = stop
    marked_text = "".join(["…" * (begin > 0), *parts, text[at:last], "…" * (end < len(words))])
    marks = [(tokens[first].char_offset_from, after - first) for first, after in shown]
    return " ".join(marked_text.split()), marks


def _spans(words: Sequence[str], marked: Sequence[IndexedTerm]) -> list[tuple[int, int, int]]:
    """Where the terms stand, none inside of another: the first word, one past the last, and the
    number of the term; the first, and of these the longest.
    """
    spans = []
    for number, term in enumerate(marked):
        spans += [(at, at + len(term.words), number) for at in term.places(words)]
    kept: list[tuple[int, int, int]] = []
    for span in sorted(spans, key=lambda span: (span[0], -span[1])):
        if not kept or span[0] >= kept[-1][1]:
            kept.append(span)
    return kept


def _begin(spans: Sequence[tuple[int, int, int]], count: int) -> int:
    """The first word of the best part, what is marked in the middle of it."""
    best, begin = (0, 0, 0), 0
    for first, _, _ in spans:
        near = [span for span in spans if span[0] >= first and span[1] <= first + MOST]
        longest = max((after - start for start, after, _ in near), default=0)
        worth = longest, len({term for _, _, term in near}), len(near)
        if near and worth > best:
            best = worth
            begin = first - (MOST - (near[-1][1] - first)) // 2
    return max(0, min(begin, count - MOST))
