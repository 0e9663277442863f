"""What an index of tantivy's looks like, and how it is asked (kb.search.writer writes it).

A passage is one document. Its `words` are its title twice, its headings, its text and its alt texts
one after the other, so that a word of the title counts twice; a phrase never reaches from one into
the next. Beside them stand what filters ask for, and `row`, all that an answer shows.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple, TypeVar

import orjson
import tantivy
from tantivy import Occur, Query

from kb.core.errors import DamagedData
from kb.search.analysis import analyzer
from kb.search.passage import KINDS, Passage
from kb.store import indexed

WORDS, KEY, KIND, THING, DAY, ROW = "words", "key", "kind", "thing", "day", "row"
_SPECIAL = re.compile(r"[^\w\s]")  # signs of a pattern; folding makes some: "⑴" is "(1)"
_Given = TypeVar("_Given")


class Address(NamedTuple):
    """Where a passage is in an index; they sort as they were written."""

    segment: int
    number: int


def schema() -> tantivy.Schema:
    """The fields of a passage."""
    made = tantivy.SchemaBuilder()
    made.add_text_field(WORDS, tokenizer_name="whitespace")
    made.add_text_field(KEY, tokenizer_name="raw", index_option="basic")
    for name in (KIND, THING, DAY):
        made.add_integer_field(name, fast=True)
    made.add_bytes_field(ROW, stored=True)
    return made.build()


def day(date: str) -> int:
    """ "2026-11-20" as the number that stands for it."""
    return int(date.replace("-", ""))


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
        first, last = (day(one) if one else None for one in (since, until))
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
    with tempfile.TemporaryDirectory(prefix="lorecrawl-index-") as scratch:
        for path in folder.iterdir():
            if path.name not in indexed.LOCKS:
                Path(scratch, path.name).symlink_to(path.absolute())
        return tantivy.Index.open(scratch)  # its files are open, and stay
