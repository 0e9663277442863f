"""Writes and queries an index of tantivy.

A passage is one document. Its `words` are its title twice, its headings, its text and its alt texts
one after the other, so that a word of the title counts twice; a phrase never reaches from one into
the next. `name` is the title as one word, so that it is found whatever its signs and spaces: with
all its words, without those on tantivy's list of its language's stop words, and without what stands
in brackets behind it. Next to them are the fields that filters use, and `row`, all that an answer
shows.
"""

import contextlib
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import orjson
import tantivy
from tantivy import Filter, Query, Tokenizer

from kb.artifacts import index as index_of
from kb.core.errors import SettingError
from kb.core.regular_file import check_regular
from kb.core.scripts import UNSPACED
from kb.core.sources import KINDS, PAGES
from kb.search.passage import Passage
from kb.store.damage import opening, unreadable
from kb.store.exhausted import full_disk_is_resumable

WORDS, NAME, KEY, KIND, NUMBER = "words", "name", "key", "kind", "number"
THING, DAY, ROW = "thing", "day", "row"
ANALYZER = "words"  # the name of kb.search.tantivy_index.analyzer in an index
_SPECIAL = re.compile(r"[^\w\s]")  # signs of a pattern; folding makes some: "⑴" is "(1)"


class IndexHit(NamedTuple):
    """A passage that a query found: its score, its number and its thing's in the order of writing,
    and tantivy's address of it (segment, document).
    """

    score: float
    number: int
    thing: int
    address: tuple[int, int]


def schema() -> tantivy.Schema:
    """The fields of a passage."""
    made = tantivy.SchemaBuilder()
    made.add_text_field(WORDS, tokenizer_name=ANALYZER)
    for name in (NAME, KEY, KIND):
        made.add_text_field(name, tokenizer_name="raw", index_option="basic")
    for name in (NUMBER, THING, DAY):
        made.add_integer_field(name, fast=True)
    made.add_bytes_field(ROW, stored=True)
    return made.build()


def day(date: str) -> int:
    """ "2026-11-20" as the number that stands for it."""
    return int(date.replace("-", ""))


class PassageIndex:
    """An index to ask. Raises DamagedData for one that can't be read, here and everywhere."""

    def __init__(self, folder: Path, language: str) -> None:
        self._folder = folder
        self.language = language
        self.analyzer = analyzer(language)
        with self._reading():
            opened = _open(folder)
            self._searcher = opened.searcher()
        self.schema = opened.schema
        self.size = self._searcher.num_docs

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            # tantivy writes a lock beside it.
            with opening(self._folder, ValueError), full_disk_is_resumable(self._folder):
                yield
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # tantivy's, which it does not export
                raise
            raise unreadable(self._folder, "the index is damaged") from None

    def frequency(self, word: str) -> int:
        """How many passages have a word of the analyzer's."""
        with self._reading():
            return self._searcher.doc_freq(WORDS, word)

    def count(self, query: Query) -> int:
        """How many passages a query finds."""
        with self._reading():
            return int(self._searcher.search(query, 1).count)  # type: ignore[attr-defined]

    def frequencies(self, prefix: str, most: int) -> list[tuple[str, int]]:
        """The most frequent words that begin like this, and how many passages have them."""
        with self._reading():
            return self._searcher.terms_with_prefix(WORDS, prefix, limit=most)

    def phrase(self, words: list[str]) -> Query:
        """Passages with a word, or with several side by side."""
        if len(words) == 1:
            return Query.term_query(self.schema, WORDS, words[0], "position")
        return Query.phrase_query(self.schema, WORDS, list(words))

    def in_order(self, places: list[tuple[int, str]]) -> Query:
        """Passages with these words (place, word) so far apart, or one place more or less."""
        # With one place to spare no two words change places.
        return Query.phrase_query(self.schema, WORDS, list(places), slop=1)

    def beginning(self, words: list[str]) -> Query:
        """Passages with these words side by side, the last of which is how a word begins."""
        patterns = [_SPECIAL.sub(r"\\\g<0>", word) for word in words]
        patterns[-1] += ".*"
        if len(words) == 1:
            return Query.regex_query(self.schema, WORDS, patterns[0])
        return Query.regex_phrase_query(self.schema, WORDS, list(patterns))

    def days(self, since: str, until: str) -> Query:
        """Passages of these days, both included; either may be "". None without a date."""
        first, last = (day(date) if date else None for date in (since, until))
        return Query.range_query(self.schema, DAY, tantivy.FieldType.Integer, first, last)

    def kinds(self, kinds: Iterable[str]) -> Query:
        """Passages of these kinds."""
        return Query.term_set_query(self.schema, KIND, list(kinds))

    def keys(self, keys: Iterable[str]) -> Query:
        return Query.term_set_query(self.schema, KEY, list(keys))

    def named(self, words: Iterable[str], *, pages: bool) -> Query | None:
        """Passages of the pages, or of other things, with this title; None for none."""
        name = f"{pages:d}{''.join(self.analyzer.analyze(' '.join(words)))}"
        with self._reading():
            if not self._searcher.doc_freq(NAME, name):
                return None
        return Query.term_query(self.schema, NAME, name, "basic")

    def best(self, query: Query, most: int) -> list[IndexHit]:
        """The passages of a query with the highest scores; the order of equal ones is random."""
        with self._reading():
            hits = self._searcher.search(query, most, count=False).hits
            places = [place for _, place in hits]
            numbers = self._searcher.fast_field_values(NUMBER, places)
            things = self._searcher.fast_field_values(THING, places)
        return [
            IndexHit(score, int(number or 0), int(thing or 0), (place.segment_ord, place.doc))
            for (score, place), number, thing in zip(hits, numbers, things, strict=True)
        ]

    def first(self, query: Query, most: int) -> list[Passage]:
        """The passages of a query that were written first."""
        with self._reading():
            hits = self._searcher.search(
                query, most, count=False, order_by_field=NUMBER, order=tantivy.Order.Asc
            ).hits
        return [self.passage((place.segment_ord, place.doc)) for _, place in hits]

    def passage(self, address: tuple[int, int]) -> Passage:
        """The passage at an address."""
        with self._reading():
            document = self._searcher.doc(tantivy.DocAddress(*address))
            return Passage(*orjson.loads(document.get_first(ROW) or b""))


def _open(folder: Path) -> tantivy.Index:
    """An index, by links to its files where the folder lets no lock be written."""
    for path in folder.iterdir():
        if not path.is_dir():  # such as lost+found, which tantivy does not open
            check_regular(path)
    if os.access(folder, os.W_OK):
        return tantivy.Index.open(str(folder))
    with tempfile.TemporaryDirectory(prefix="lorecrawl-index-") as scratch:
        for path in folder.iterdir():
            if path.name not in index_of.LOCKS:
                Path(scratch, path.name).symlink_to(path.absolute())
        return tantivy.Index.open(scratch)  # its files are open, and stay


STEMMERS = {
    "ar": "arabic", "da": "danish", "de": "german", "el": "greek", "en": "english",
    "es": "spanish", "fi": "finnish", "fr": "french", "hu": "hungarian", "it": "italian",
    "nb": "norwegian", "nl": "dutch", "nn": "norwegian", "pt": "portuguese",
    "ro": "romanian", "ru": "russian", "sv": "swedish", "ta": "tamil", "tr": "turkish",
}  # fmt: skip


# Where no spaces stand between words each sign is one, so that several are found as phrases.
_WORD = (
    rf"[[{UNSPACED}]&&[\p{{Alphabetic}}\p{{N}}\p{{M}}]]"
    rf"|[[\p{{Alphabetic}}\p{{N}}]--[{UNSPACED}]]+"
)


def analyzer(language: str) -> tantivy.TextAnalyzer:
    """A text's words: runs of letters and digits, small, without accents, and stemmed where the
    language has a stemmer.
    """
    stemmer = STEMMERS.get(language)
    made = tantivy.TextAnalyzerBuilder(Tokenizer.regex(_WORD))
    made = made.filter(Filter.lowercase()).filter(Filter.ascii_fold())
    return (made.filter(Filter.stemmer(stemmer)) if stemmer else made).build()


_WITH_STOP_WORDS = {
    "danish", "dutch", "english", "finnish", "french", "german", "hungarian", "italian",
    "norwegian", "portuguese", "russian", "spanish", "swedish",
}  # fmt: skip
_BEHIND = re.compile(r"\s*\([^()]*\)\s*$")


def names(title: str, language: str) -> set[str]:
    """What a title is found by as a whole."""
    texts = {title, _BEHIND.sub("", title)}
    if STEMMERS.get(language) in _WITH_STOP_WORDS:
        split = tantivy.TextAnalyzerBuilder(Tokenizer.regex(_WORD)).filter(Filter.lowercase())
        large = split.filter(Filter.stopword(STEMMERS[language])).build()
        texts |= {" ".join(large.analyze(text)) for text in texts}
    full = analyzer(language)
    return {"".join(full.analyze(text)) for text in texts} - {""}


_HEAP = 128 << 20  # bytes that all threads of a writer may take before they write a segment
_THREADS = 2  # on any machine, so that the memory is the same
_AT_ONCE = 4_096  # passages between two reports of progress


def write_index(
    folder: Path,
    language: str,
    passages: Iterable[Passage],
    advance: Callable[[int], object],
    heap: int = _HEAP,
) -> int:
    """Write an index of passages into an empty folder and return how many they are.

    `advance` is called with the number of passages written since the last call. The passages of
    one thing come together. On a full disk tantivy says only that one of its threads failed.
    """
    index = tantivy.Index(schema(), path=str(folder))
    index.register_tokenizer(ANALYZER, analyzer(language))
    count = reported = things = 0
    thing = title = None
    found_by: set[str] = set()
    writer = index.writer(heap_size=heap, num_threads=_THREADS)
    for count, passage in enumerate(passages, 1):
        things += passage.thing != thing
        thing = passage.thing
        if title != passage.title:
            title = passage.title
            found_by = names(title, language)
        writer.add_document(_document(passage, found_by, count, things))
        if count - reported == _AT_ONCE:
            advance(_AT_ONCE)
            reported = count
    writer.commit()
    writer.wait_merging_threads()
    advance(count - reported)
    written = PassageIndex(folder, language).size
    assert written == count, f"{written} of {count} passages in {folder}"
    return count


def _document(
    passage: Passage, found_by: Iterable[str], number: int, thing: int
) -> tantivy.Document:
    if passage.kind not in KINDS:
        raise SettingError(
            f"a passage is of the kind {passage.kind!r}, which its source does not declare",
            hint="add it to `kinds` in schemas/sources/ of the source's package",
        )
    made = tantivy.Document()
    for text in (passage.title, passage.title, passage.path, passage.text, passage.alt):
        if text:
            made.add_text(WORDS, text)
    for name in found_by:
        made.add_text(NAME, f"{passage.kind in PAGES:d}{name}")
    made.add_text(KEY, passage.key)
    made.add_text(KIND, passage.kind)
    made.add_integer(NUMBER, number)
    made.add_integer(THING, thing)
    if passage.date:
        made.add_integer(DAY, day(passage.date))
    made.add_bytes(ROW, orjson.dumps(tuple(passage)))
    return made
