"""The words of texts, as an index has them and a question asks for them."""

from __future__ import annotations

import tantivy
from tantivy import Filter, Tokenizer

STEMMERS = {
    "ar": "arabic", "da": "danish", "de": "german", "el": "greek", "en": "english",
    "es": "spanish", "fi": "finnish", "fr": "french", "hu": "hungarian", "it": "italian",
    "nb": "norwegian", "nl": "dutch", "nn": "norwegian", "no": "norwegian", "pt": "portuguese",
    "ro": "romanian", "ru": "russian", "sv": "swedish", "ta": "tamil", "tr": "turkish",
}  # fmt: skip


def analyzer(stemmer: str) -> tantivy.TextAnalyzer:
    """A text's words: runs of letters and digits, small, without accents, and stemmed unless
    `stemmer` is "".
    """
    made = tantivy.TextAnalyzerBuilder(Tokenizer.simple())
    made = made.filter(Filter.lowercase()).filter(Filter.ascii_fold())
    return (made.filter(Filter.stemmer(stemmer)) if stemmer else made).build()
