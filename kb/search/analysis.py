"""The words of texts, as an index has them and a question asks for them."""

from __future__ import annotations

from functools import lru_cache

import pyarrow as pa
import pyarrow.compute as pc
import tantivy
from tantivy import Filter, Tokenizer

STEMMERS = {
    "ar": "arabic", "da": "danish", "de": "german", "el": "greek", "en": "english",
    "es": "spanish", "fi": "finnish", "fr": "french", "hu": "hungarian", "it": "italian",
    "nb": "norwegian", "nl": "dutch", "nn": "norwegian", "no": "norwegian", "pt": "portuguese",
    "ro": "romanian", "ru": "russian", "sv": "swedish", "ta": "tamil", "tr": "turkish",
}  # fmt: skip
_KEPT = 200_000  # words
_LINES = 256  # titles and headings, which are those of the passage before more often than not


def analyzer(stemmer: str) -> tantivy.TextAnalyzer:
    """A text's words: runs of letters and digits, small, without accents, and stemmed unless
    `stemmer` is "".
    """
    made = tantivy.TextAnalyzerBuilder(Tokenizer.simple())
    made = made.filter(Filter.lowercase()).filter(Filter.ascii_fold())
    return (made.filter(Filter.stemmer(stemmer)) if stemmer else made).build()


class Words(dict[str, str]):
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
