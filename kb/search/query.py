"""Parses a search query.

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
from typing import NamedTuple

from kb.core.errors import UsageError

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
    "cant", "doesnt", "dont", "hows", "im", "ive", "whats", "wheres", "whos",
}  # fmt: skip
_NEGATED = {
    "aren", "couldn", "didn", "doesn", "don", "hadn", "hasn", "haven", "isn", "shouldn", "wasn",
    "weren", "won", "wouldn",
}  # fmt: skip
_SHORTENED = {"d", "ll", "m", "re", "s", "t", "ve"}  # behind an apostrophe
# What is asked about anything, beside what it is asked about.
_ASKING = {
    "anyone", "best", "build", "building", "craft", "crafting", "difference", "easiest", "easily",
    "explain", "fast", "fastest", "find", "finding", "get", "getting", "gets", "good", "guide",
    "happen", "happens", "help", "kind", "know", "list", "long", "look", "looks", "made", "make",
    "makes", "making", "many", "mean", "means", "much", "need", "needed", "obtain", "obtaining",
    "quickly", "recipe", "show", "tell", "thing", "things", "tips", "tutorial", "type", "types",
    "use", "used", "uses", "using", "want", "way", "ways", "work", "working", "works",
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
    """Whether a word only makes a sentence; "what's" comes as two."""
    first, *rest = word.lower().split()
    if not _SHORTENED.issuperset(rest):
        return False
    return first in _SMALL or (first in _NEGATED and rest == ["t"])


def is_asking(word: str) -> bool:
    """Whether a word says what is asked, and not about what."""
    return is_small(word) or word.lower() in _ASKING


def clean(text: str) -> str:
    """The text without what is no sign (control characters, surrogates), accents in one
    character with their letters.
    """
    signs = "".join(" " if unicodedata.category(one) in ("Cc", "Cs") else one for one in text)
    return unicodedata.normalize("NFC", signs)
