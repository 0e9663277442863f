"""Corrects misspelt words of a query, using the words of the indexes."""

import re
from collections import Counter
from collections.abc import Sequence
from difflib import SequenceMatcher

from kb.search.query import clean, question
from kb.search.tantivy_index import PassageIndex

_KNOWN = 50_000  # most frequent words with the same first letter that are compared
_LEAST = 0.7  # similarity (difflib's ratio) of a word to one that is suggested for it
_AS_NEAR = 0.05  # of such a similarity: within that the more frequent word is taken
_READ = 20  # passages in which the spelling of a stem is looked up


def corrected(indexes: Sequence[PassageIndex], query: str) -> str:
    """The query with each word that is in none of these indexes in its nearest spelling.

    "" where every word is in some passage, or no other is near. The first letter of a word is taken
    as typed. Raises UsageError for a query without a word.
    """
    asked = question(query)
    text = clean(query)
    for word in {word for term in asked.terms if not term.prefix for word in term.text.split()}:
        if not any(_frequency(index, word) for index in indexes) and (
            other := _nearest(indexes, word)
        ):
            text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", other, text)
    return "" if text == clean(query) else text


def _frequency(index: PassageIndex, word: str) -> int:
    return min(map(index.frequency, index.analyzer.analyze(word)), default=1)


def _nearest(indexes: Sequence[PassageIndex], word: str) -> str:
    """The word of a passage that is most like a given one, "" where none is."""
    frequencies: Counter[str] = Counter()
    stem = "".join(indexes[0].analyzer.analyze(word))
    for index in indexes:
        frequencies.update(dict(index.frequencies(stem[:1], _KNOWN)))
    matcher = SequenceMatcher(b=stem, autojunk=False)
    near: dict[str, float] = {}
    for other in frequencies:
        matcher.set_seq1(other)
        if matcher.real_quick_ratio() >= _LEAST and matcher.quick_ratio() >= _LEAST:
            near[other] = matcher.ratio()
    most = max(near.values(), default=0.0)
    if most < _LEAST:
        return ""
    best = [other for other, ratio in near.items() if ratio >= most - _AS_NEAR]
    return _spelling(indexes, min(best, key=lambda one: (-frequencies[one], one)), word)


def _spelling(indexes: Sequence[PassageIndex], stem: str, word: str) -> str:
    """The word with this stem, in the first passages that have one, that is most like `word`."""
    spellings: Counter[str] = Counter()
    for index in indexes:
        for passage in index.first(index.phrase([stem]), _READ):
            text = f"{passage.title} {passage.path} {passage.text} {passage.alt}".lower()
            spellings.update(
                text[token.char_offset_from : token.char_offset_to]
                for token in index.analyzer.pre_tokenize(text).tokens
                if token.text == stem
            )
    ratio = SequenceMatcher(b=word.lower(), autojunk=False)

    def order(spelling: str) -> tuple[float, int, str]:
        ratio.set_seq1(spelling)
        return -ratio.ratio(), -spellings[spelling], spelling

    return min(spellings, key=order, default=stem)
