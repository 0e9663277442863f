"""What a person types, as questions to FTS5.

    wolf tame       either word, the more and the rarer the better; words that only make a
                    sentence ("how", "the") count where nothing else is asked for
    "bed rock"      these words side by side; an answer has to have them
    +wolf  -dog     has to have it; must not have it
    craft*          words that begin like this

Whatever else is typed is words or nothing: quotes that do not close, NEAR, AND, brackets and
columns mean nothing here, and no text is an error.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from typing import NamedTuple

MOST = 32  # terms of one question; what is typed after them is left out
_TERM = re.compile(r'(?P<sign>(?<!\S)[+-])?(?:"(?P<phrase>[^"]*)"?|(?P<word>[^\s"]+))(?P<any>\*)?')
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
    """A word or phrase as FTS5 takes it, and whether it is a plain word, which may be left out."""

    match: str
    plain: bool


class Question(NamedTuple):
    """What makes an answer better, what it has to have, and what it must not have."""

    terms: tuple[Term, ...]
    needed: tuple[str, ...]
    barred: tuple[str, ...]


def question(text: str) -> Question:
    """The question in a text. Without any word in it there are no terms."""
    terms: dict[str, Term] = {}
    needed: dict[str, None] = {}
    barred: dict[str, None] = {}
    for found in _TERM.finditer(_clean(text)):
        sign, phrase = found["sign"], found["phrase"]
        word = found["word"] if phrase is None else phrase
        prefix = bool(found["any"]) or (phrase is None and word.endswith("*"))
        match = _quoted(word, prefix=prefix)
        if not match:
            continue
        if sign == "-":
            barred[match] = None
            continue
        must = sign == "+" or phrase is not None
        terms.setdefault(match, Term(match, plain=not must))
        if must:
            needed[match] = None
            terms[match] = Term(match, plain=False)
    kept = tuple(_telling(terms.values()))[:MOST]
    return Question(kept, tuple(needed)[:MOST], tuple(barred)[:MOST])


def _telling(terms: Collection[Term]) -> Collection[Term]:
    """Without small words, unless there are no others."""
    return [
        one for one in terms if not one.plain or one.match.strip('"').lower() not in _SMALL
    ] or terms


def _clean(text: str) -> str:
    """The text without what SQLite can't take, or is no sign: control characters, surrogates."""
    return "".join(" " if unicodedata.category(one) in ("Cc", "Cs") else one for one in text)


def _quoted(words: str, *, prefix: bool) -> str:
    """The words as a phrase of FTS5; "" where nothing in them is a letter or digit."""
    kept = "".join(one if _counts(one) else " " for one in words).split()
    if not kept:
        return ""
    return '"' + " ".join(kept) + '"' + (" *" if prefix else "")


def _counts(one: str) -> bool:
    """Whether the tokenizer takes a character for one of a word (letters, digits, marks)."""
    return unicodedata.category(one)[0] in "LNM" or unicodedata.category(one) == "Co"
