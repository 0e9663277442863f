"""The one place that knows tantivy: what an index looks like, how it is written and asked.

A passage is one document. Its `words` are its title twice, its headings, its text and its alt texts
one after the other, so that a word of the title counts twice; a phrase never reaches from one into
the next. Beside them stand what filters ask for, and `row`, all that an answer shows.

The same passages give the same bytes. Whole threads, pages and videos go to two writers in turn,
on any machine; each has a thread of its own and begins a new index before its words fill the memory
that it has. So every one of these becomes one segment, none is ever merged with another (when that
happens is chance), and all are put together to one index, under numbers instead of drawn names.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import orjson
import pyarrow as pa
import pyarrow.compute as pc
import tantivy
from tantivy import Filter, Occur, Query, Tokenizer

from kb.core.errors import DamagedData, DiskFull
from kb.search.passage import KINDS, Passage
from kb.store import indexed
from kb.store.atomic import FULL_HINT

STEMMERS = {
    "ar": "arabic", "da": "danish", "de": "german", "el": "greek", "en": "english",
    "es": "spanish", "fi": "finnish", "fr": "french", "hu": "hungarian", "it": "italian",
    "nb": "norwegian", "nl": "dutch", "nn": "norwegian", "no": "norwegian", "pt": "portuguese",
    "ro": "romanian", "ru": "russian", "sv": "swedish", "ta": "tamil", "tr": "turkish",
}  # fmt: skip
WORDS, KEY, KIND, THING, DAY, ROW = "words", "key", "kind", "thing", "day", "row"
_META, _PARTS = "meta.json", "parts"
_WRITERS = 2
_AT_ONCE = 4_096  # passages whose words are looked up together
_KEPT = 200_000  # words
_LINES = 256  # titles and headings, which are those of the passage before more often than not
_PART = 64 << 20  # characters of a segment's words; they take about as many bytes of memory
_HEAP = 256 << 20  # bytes that a writer may take; full, it would begin a second segment
_LEAST_ROOM = 64 << 20  # bytes; where less is left on the disk, that is why a writer failed
_SPECIAL = re.compile(r"[^\w\s]")  # signs of a pattern; folding makes some: "⑴" is "(1)"
_Given = TypeVar("_Given")


class Address(NamedTuple):
    """Where a passage is in an index; they sort as they were written."""

    segment: int
    number: int


def analyzer(stemmer: str) -> tantivy.TextAnalyzer:
    """A text's words: runs of letters and digits, small, without accents, and stemmed unless
    `stemmer` is "".
    """
    made = tantivy.TextAnalyzerBuilder(Tokenizer.simple())
    made = made.filter(Filter.lowercase()).filter(Filter.ascii_fold())
    return (made.filter(Filter.stemmer(stemmer)) if stemmer else made).build()


class _Words(dict[str, str]):
    """Texts as the words that `analyzer` finds in them, with spaces between. What was found for
    whatever stands between two spaces is kept: a stem takes longer than all else.
    """

    def __init__(self, stemmer: str) -> None:
        super().__init__()
        self._analyze = analyzer(stemmer).analyze
        self.line = lru_cache(_LINES)(self._line)

    def __missing__(self, given: str) -> str:
        if len(self) >= _KEPT:
            self.clear()
        found = self[given] = " ".join(self._analyze(given))
        return found

    def _line(self, text: str) -> str:
        return " ".join(map(self.__getitem__, text.split()))

    def texts(self, texts: list[str]) -> list[str]:
        """The same for many texts, each different word of which is looked up once."""
        parts = pc.utf8_split_whitespace(pa.array(texts, pa.string()))
        coded = pc.list_flatten(parts).dictionary_encode()
        words = pa.array(map(self.__getitem__, coded.dictionary.to_pylist()), pa.string())
        found = pa.ListArray.from_arrays(parts.offsets, words.take(coded.indices))
        joined: list[str] = pc.binary_join(found, " ").to_pylist()
        return joined


def write(
    folder: Path, stemmer: str, passages: Iterable[Passage], told: Callable[[int], object]
) -> int:
    """An index of passages into an empty folder; how many they were. `told` hears of more of them.

    The passages of a thing come together. Raises DiskFull.
    """
    parts, words = folder / _PARTS, _Words(stemmer)
    writers = [_Writer(parts / str(number), words) for number in range(_WRITERS)]
    count, number, thing = 0, -1, None
    rest = iter(passages)
    with _full_disk_is_told(folder):
        while some := list(islice(rest, _AT_ONCE)):
            for one, text in zip(some, words.texts([one.text for one in some]), strict=True):
                number += one.thing != thing
                thing = one.thing
                writers[number % _WRITERS].add(one, text, number)
            count += len(some)
            told(len(some))
        _put_together(folder, [part for one in writers for part in one.end()], count)
    shutil.rmtree(parts)
    return count


class _Writer:
    """Writes index after index, each of which is one segment."""

    def __init__(self, parts: Path, words: _Words) -> None:
        self._parts, self._words = parts, words
        self._done = self._held = 0
        self._writer: tantivy.IndexWriter | None = None

    def add(self, one: Passage, text: str, thing: int) -> None:
        """A passage, its text's words and the number of its thing."""
        if self._writer is None or self._held > _PART:
            self._begin()
        assert self._writer is not None
        title = self._words.line(one.title)
        path, alt = self._words.line(one.path), self._words.line(one.alt)
        self._writer.add_document(_document(one, (title, title, path, text, alt), thing))
        self._held += 2 * len(title) + len(path) + len(text) + len(alt)

    def _begin(self) -> None:
        self._finish()
        folder = self._folder(self._done)
        folder.mkdir(parents=True)
        index = tantivy.Index(_schema(), path=str(folder))
        self._writer, self._held = index.writer(heap_size=_HEAP, num_threads=1), 0

    def _finish(self) -> None:
        if self._writer is not None:
            self._writer.commit()
            self._writer.wait_merging_threads()
            self._writer, self._done = None, self._done + 1

    def end(self) -> list[Path]:
        """The indexes in the order in which they were written; at least one."""
        if self._writer is None:
            self._begin()
        self._finish()
        return [self._folder(number) for number in range(self._done)]

    def _folder(self, number: int) -> Path:
        return self._parts / str(number)


def _schema() -> tantivy.Schema:
    made = tantivy.SchemaBuilder()
    made.add_text_field(WORDS, tokenizer_name="whitespace")
    made.add_text_field(KEY, tokenizer_name="raw", index_option="basic")
    for name in (KIND, THING, DAY):
        made.add_integer_field(name, fast=True)
    made.add_bytes_field(ROW, stored=True)
    return made.build()


def _document(one: Passage, words: Iterable[str], thing: int) -> tantivy.Document:
    made = tantivy.Document()
    for some in words:
        if some:
            made.add_text(WORDS, some)
    made.add_text(KEY, one.key)
    made.add_integer(KIND, KINDS.index(one.kind))
    made.add_integer(THING, thing)
    if one.date:
        made.add_integer(DAY, _day(one.date))
    made.add_bytes(ROW, orjson.dumps(tuple(one)))
    return made


def _day(date: str) -> int:
    return int(date.replace("-", ""))


def _put_together(folder: Path, parts: list[Path], count: int) -> None:
    """Every part's segments to one index, under numbers for names."""
    segments: list[dict[str, Any]] = []
    meta: dict[str, Any] = {}
    for part in parts:
        meta = json.loads((part / _META).read_text(encoding="utf-8"))
        for one in sorted(meta["segments"], key=lambda one: -one["max_doc"]):
            name, number = uuid.UUID(one["segment_id"]).hex, uuid.UUID(int=len(segments) + 1)
            for path in part.glob(f"{name}.*"):
                os.rename(path, folder / f"{number.hex}{path.suffix}")
            segments.append({**one, "segment_id": str(number)})
    meta |= {"segments": segments, "opstamp": count}
    (folder / _META).write_text(json.dumps(meta, indent=1), encoding="utf-8")
    written = Opened(folder, "").size
    assert written == count, f"{written} of {count} passages in {folder}"


@contextlib.contextmanager
def _full_disk_is_told(folder: Path) -> Iterator[None]:
    """tantivy says only that a thread of it failed."""
    try:
        yield
    except ValueError as error:
        if shutil.disk_usage(folder).free < _LEAST_ROOM:
            raise DiskFull(f"no room to write {folder}", hint=FULL_HINT) from error
        raise


class Opened:
    """An index to ask. Raises DamagedData for one that can't be read, here and everywhere."""

    def __init__(self, folder: Path, stemmer: str) -> None:
        self._folder = folder
        self.analyzer = analyzer(stemmer)
        self._index = self._read(lambda: _open(folder))
        self.schema = self._index.schema
        self._searcher = self._read(self._index.searcher)
        self.size = self._searcher.num_docs

    def _read(self, ask: Callable[[], _Given]) -> _Given:
        try:
            return ask()
        except Exception as error:
            raise self._damaged() from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # tantivy's; its class has no address
                raise
            raise self._damaged() from None

    def _damaged(self) -> DamagedData:
        return DamagedData(f"{self._folder} can't be read", hint="run `kb index --again`")

    def having(self, word: str) -> int:
        """How many passages have a word of the analyzer's."""
        return self._read(lambda: self._searcher.doc_freq(WORDS, word))

    def count(self, query: Query) -> int:
        """How many passages a query finds."""
        return int(self._read(lambda: self._searcher.search(query, 1)).count)  # type: ignore[attr-defined]

    def beginning(self, prefix: str, most: int) -> list[str]:
        """The words that begin like this, the most frequent first."""
        found = self._read(lambda: self._searcher.terms_with_prefix(WORDS, prefix, limit=most))
        return [word for word, _ in found]

    def words(self, words: list[str]) -> Query:
        """Passages with a word, or with several side by side."""
        if len(words) == 1:
            return Query.term_query(self.schema, WORDS, words[0], "position")
        return Query.phrase_query(self.schema, WORDS, list(words))

    def like(self, prefix: str) -> Query:
        """Passages with a word that begins like this."""
        pattern = _SPECIAL.sub(r"\\\g<0>", prefix)
        return Query.regex_query(self.schema, WORDS, f"{pattern}.*")

    def days(self, since: str, until: str) -> Query:
        """Passages of these days, both included; either may be "". None without a date."""
        first, last = (_day(one) if one else None for one in (since, until))
        return Query.range_query(self.schema, DAY, tantivy.FieldType.Integer, first, last)

    def kinds(self, kinds: Iterable[str]) -> Query:
        """Passages of these kinds."""
        numbers = [KINDS.index(one) for one in kinds]
        whole = tantivy.FieldType.Integer
        return Query.boolean_query(
            [(Occur.Should, Query.range_query(self.schema, KIND, whole, n, n)) for n in numbers]
        )

    def keys(self, keys: Iterable[str]) -> Query:
        """Passages of these keys."""
        return Query.term_set_query(self.schema, KEY, list(keys))

    def best(self, query: Query, most: int) -> list[tuple[float, Address, int]]:
        """The best passages of a query with their scores and the numbers of their things; of equal
        ones those that were written first.
        """
        hits = self._read(lambda: self._searcher.search(query, most, count=False)).hits
        places = [place for _, place in hits]
        things = self._read(lambda: self._searcher.fast_field_values(THING, places))
        return [
            (score, Address(place.segment_ord, place.doc), int(thing or 0))
            for (score, place), thing in zip(hits, things, strict=True)
        ]

    def passage(self, place: Address) -> Passage:
        """What stands there."""
        found = self._read(lambda: self._searcher.doc(tantivy.DocAddress(*place)))
        return Passage(*self._read(lambda: orjson.loads(found.get_first(ROW) or b"")))


def _open(folder: Path) -> tantivy.Index:
    """An index, by links to its files where the folder lets no lock be written."""
    if os.access(folder, os.W_OK):
        return tantivy.Index.open(str(folder))
    with tempfile.TemporaryDirectory(prefix="lorebase-index-") as scratch:
        for path in folder.iterdir():
            if path.name not in indexed.LOCKS:
                Path(scratch, path.name).symlink_to(path.absolute())
        return tantivy.Index.open(scratch)  # its files are open, and stay
