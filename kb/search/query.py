"""Parses a search query, and corrects its misspelt words by the words of the indexes.

    wolf tame       either word, the more and the rarer the better; words that only make a
                    sentence ("how", "the") count where nothing else is asked for
    "bed rock"      these words side by side; an answer has to have them
    +wolf  -dog     has to have it; must not have it
    craft*          words that begin like this

Whatever else is typed is words or nothing: quotes that do not close, NEAR, AND, brackets and
columns mean nothing here. Only a text without a word to look for is an error.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from difflib import SequenceMatcher, get_close_matches
from typing import NamedTuple

from kb.core.errors import UsageError
from kb.search.tantivy_index import PassageIndex

MOST = 32  # terms of one question; what is typed after them is left out
_TERM = re.compile(r'(?P<sign>(?<!\S)[+-])?(?:"(?P<phrase>[^"]*)"?|(?P<word>[^\s"]+))(?P<any>\*)?')
_BETWEEN = re.compile(r"[,;:!?/|&=\u3001\u3002\uff0c\uff1b]+")
# What questions are made with. Titles are questions too, and would match these alone.
_SMALL = {
    "a", "about", "am", "an", "and", "any", "are", "as", "at", "be", "been", "but", "by",
    "can", "could", "did", "do", "does", "for", "from", "had", "has", "have", "he", "her",
    "here", "him", "his", "how", "i", "if", "in", "into", "is", "it", "its", "just", "may",
    "me", "might", "must", "my", "of", "on", "or", "our", "she", "should", "so", "than",
    "that", "the", "their", "them", "then", "there", "these", "they", "this", "those", "to",
    "us", "was", "we", "were", "what", "when", "where", "which", "who", "whom", "whose", "why",
    "will", "with", "would", "you", "your",
}  # fmt: skip


class Term(NamedTuple):
    """Words side by side, most often one; as a `prefix` the last is how a word begins."""

    text: str
    prefix: bool = False


class Question(NamedTuple):
    """What makes an answer better, what it has to have, and what it must not have.

    `run`: all words in the order asked, small ones too; () where a prefix is among them, as nothing
    says where its word ends, or for a single word.
    """

    terms: tuple[Term, ...]
    needed: tuple[Term, ...]
    barred: tuple[Term, ...]
    run: tuple[str, ...] = ()

    @property
    def pairs(self) -> list[Term]:
        """Each two neighbours of the first MOST words of `run` of which one is not small."""
        neighbours = zip(self.run[:MOST], self.run[1:MOST], strict=False)
        return [Term(f"{a} {b}") for a, b in neighbours if not (is_small(a) and is_small(b))]


def question(text: str) -> Question:
    """The question in a text. Raises UsageError without a word to look for."""
    terms: dict[Term, None] = {}
    needed: dict[Term, None] = {}
    barred: dict[Term, None] = {}
    run: list[str] = []
    for match in _TERM.finditer(clean(text)):
        sign, phrase = match["sign"], match["phrase"]
        # "wolf,tame" is two words; what else stands inside of one holds it together (e-mail).
        parts = _BETWEEN.split(match["word"]) if phrase is None else [phrase]
        for number, word in enumerate(parts, 1):
            ends = phrase is None and word.endswith("*")
            prefix = ends or (bool(match["any"]) and number == len(parts))
            kinds = [unicodedata.category(one) for one in word]
            kept = "".join(
                one if kind[0] in "LNM" or kind == "Co" else " "
                for one, kind in zip(word, kinds, strict=True)
            ).split()
            if not kept:
                continue
            term = Term(" ".join(kept), prefix)
            if sign == "-":
                barred[term] = None
                continue
            terms[term] = None
            run += kept
            if sign == "+" or phrase is not None:
                needed[term] = None
    if not terms:
        raise UsageError(
            f"the query {text!r} contains no word to search for",
            hint='give at least one word, e.g. kb search "how to tame a wolf"',
        )
    # Without small words, unless there are no others.
    large = [one for one in terms if one in needed or one.prefix or not is_small(one.text)]
    if len(run) < 2 or any(one.prefix for one in terms):
        run = []
    return Question(
        tuple(large or terms)[:MOST], tuple(needed)[:MOST], tuple(barred)[:MOST], tuple(run)
    )


def is_small(word: str) -> bool:
    """Whether a word only makes a sentence."""
    return word.lower() in _SMALL


def clean(text: str) -> str:
    """The text without what is no sign (control characters, surrogates), accents in one
    character with their letters.
    """
    signs = "".join(" " if unicodedata.category(one) in ("Cc", "Cs") else one for one in text)
    return unicodedata.normalize("NFC", signs)


_KNOWN = 50_000  # most frequent words with the same first letter that are compared
_LEAST = 0.7  # similarity (difflib's ratio) of a word to one that is suggested for it
_COMPARED = 20  # nearest words of which the most frequent is chosen
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
        known = any(
            min(map(index.frequency, index.analyzer.analyze(word)), default=1) for index in indexes
        )
        if not known and (other := _nearest(indexes, word)):
            text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", other, text)
    return "" if text == clean(query) else text


def _nearest(indexes: Sequence[PassageIndex], word: str) -> str:
    """The word of a passage that is most like a given one, "" where none is."""
    frequencies: Counter[str] = Counter()
    stem = "".join(indexes[0].analyzer.analyze(word))
    for index in indexes:
        frequencies.update(dict(index.frequencies(stem[:1], _KNOWN)))
    near = get_close_matches(stem, frequencies, n=_COMPARED, cutoff=_LEAST)
    if not near:
        return ""
    least = _likeness(near[0], stem) - _AS_NEAR
    best = [other for other in near if _likeness(other, stem) >= least]
    return _spelling(indexes, min(best, key=lambda one: (-frequencies[one], one)), word)


def _likeness(one: str, other: str) -> float:
    return SequenceMatcher(None, one, other).ratio()


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
    return min(
        spellings,
        key=lambda one: (-_likeness(one, word.lower()), -spellings[one], one),
        default=stem,
    )
