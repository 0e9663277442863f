"""Parses a search query.

    wolf tame       either word, the more and the rarer the better; words that only make a
                    sentence in the profile's language ("how", "the"; "wie", "der") count where
                    nothing else is asked for
    "bed rock"      these words side by side; an answer has to have them
    +wolf  -dog     has to have it; must not have it
    craft*          words that begin like this

Whatever else is typed is words or nothing: quotes that do not close, NEAR, AND, brackets and
columns mean nothing here. Only a text without a word to look for is an error.
"""

import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import NamedTuple

from stop_words import LANGUAGE_MAPPING, get_stop_words

from kb.core import scripts
from kb.core.errors import UsageError

MOST = 32  # terms of one question; what is typed after them is left out
_TERM = re.compile(r'(?P<sign>(?<!\S)[+-])?(?:"(?P<phrase>[^"]*)"?|(?P<word>[^\s"]+))(?P<any>\*)?')
_BETWEEN = re.compile(r"[,;:!?/|&=\u3001\u3002\uff0c\uff1b]+")
# What is asked about anything, beside what it is asked about, and no list of function words has.
_ASKING = {
    "build", "building", "craft", "crafting", "difference", "easiest", "easily", "explain", "fast",
    "fastest", "finding", "guide", "happen", "list", "recipe", "tips", "tutorial", "type", "types",
}  # fmt: skip
# Words that the list has as well, and that say which thing is meant.
_MEANT = {
    "big", "biggest", "first", "good", "great", "high", "higher", "last", "long", "longest", "new",
    "newer", "newest", "old", "older", "oldest", "small", "smaller", "smallest", "way", "ways",
    "young",
}  # fmt: skip
_LISTED_AS = {"nn": "nb"}  # language codes as the package stop-words has them


@cache
def function_words(language: str) -> frozenset[str]:
    """Words that a language makes sentences and questions with, as the package stop-words lists
    them; "don't" is "don" and "t". None for a language that it does not know. Its code is the
    shortest, as profiles have it.
    """
    code = _LISTED_AS.get(language, language)
    listed = get_stop_words(code) if code in LANGUAGE_MAPPING else []
    parts = {part for word in listed for part in re.findall(r"\w+", word.lower())}
    return frozenset(parts - _MEANT)


class Term(NamedTuple):
    """Words side by side, most often one; as a `prefix` the last is how a word begins."""

    text: str
    prefix: bool = False


class Question(NamedTuple):
    """What makes an answer better, what it has to have, and what it must not have.

    `run`: all words in the order asked; () where a prefix is among them, as nothing says where its
    word ends, or for a single word. `small`: those words that only make a sentence.
    """

    terms: tuple[Term, ...]
    needed: tuple[Term, ...]
    barred: tuple[Term, ...]
    run: tuple[str, ...] = ()
    small: frozenset[str] = frozenset()

    @property
    def pairs(self) -> list[Term]:
        """Each two neighbours of the first MOST words of `run` of which one is not small."""
        neighbours = zip(self.run[:MOST], self.run[1:MOST], strict=False)
        return [Term(f"{a} {b}") for a, b in neighbours if not self.small.issuperset((a, b))]

    def is_asking(self, word: str) -> bool:
        """Whether a word says what is asked, and not about what."""
        return word in self.small or word.lower() in _ASKING


def question(text: str, is_small: Callable[[str], bool] = lambda word: False) -> Question:
    """The question in a text; words that are small count where nothing else is asked for.

    Raises UsageError without a word to look for.
    """
    terms: dict[Term, None] = {}
    needed: dict[Term, None] = {}
    barred: dict[Term, None] = {}
    run: list[str] = []
    for sign, term in _typed(clean(text)):
        if sign == "-":
            barred[term] = None
            continue
        signs = scripts.words(term.text)
        if sign == "+":
            terms[term] = needed[term] = None
        elif term.prefix or len(signs) == len(term.text.split()):
            terms[term] = None
        else:
            # Nothing says where a word ends, so that each two neighbours are one.
            terms |= dict.fromkeys(map(Term, _neighbours(signs)))
        run += signs
    if not terms:
        raise UsageError(
            f"the query {text!r} contains no word to search for",
            hint='give at least one word, e.g. kb search "how to tame a wolf"',
        )
    every = (*run, *(term.text for term in terms))
    small = frozenset(word for word in every if all(map(is_small, word.lower().split())))
    large = [term for term in terms if term in needed or term.prefix or term.text not in small]
    if len(run) < 2 or any(term.prefix for term in terms):
        run = []
    return Question(
        tuple(large or terms)[:MOST], tuple(needed)[:MOST], tuple(barred)[:MOST], tuple(run), small
    )


def _typed(text: str) -> Iterator[tuple[str, Term]]:
    """What was typed: words without their punctuation, and phrases; each with its sign, "+", "-" or
    "". A phrase without a sign has "+", as its words must be there side by side.
    """
    for match in _TERM.finditer(text):
        sign, phrase = match["sign"] or "", match["phrase"]
        if phrase is not None:
            sign = sign or "+"
        # "wolf,tame" is two words; what else stands inside of one holds it together (e-mail).
        parts = _BETWEEN.split(match["word"]) if phrase is None else [phrase]
        for number, word in enumerate(parts, 1):
            ends = phrase is None and word.endswith("*")
            kinds = map(unicodedata.category, word)
            kept = "".join(
                letter if kind[0] in "LNM" or kind == "Co" else " "
                for letter, kind in zip(word, kinds, strict=True)
            ).split()
            if kept:
                yield (
                    sign,
                    Term(" ".join(kept), ends or (bool(match["any"]) and number == len(parts))),
                )


def _neighbours(signs: Sequence[str]) -> Iterator[str]:
    """Each two signs side by side of a script without spaces, and words of other scripts."""
    for first, then in zip(signs, [*signs[1:], " "], strict=True):
        if len(first) > 1:
            yield first
        elif len(then) == 1 and then != " ":
            yield first + then


def clean(text: str) -> str:
    """The text without what is no sign (control characters, surrogates), accents in one
    character with their letters.
    """
    signs = "".join(" " if unicodedata.category(sign) in ("Cc", "Cs") else sign for sign in text)
    return unicodedata.normalize("NFC", signs)
