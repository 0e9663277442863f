"""Snippets: the part of a text with most of the query's terms, which are marked in it."""

from collections.abc import Sequence
from typing import NamedTuple

from tantivy import TextAnalyzer

from kb.search.ranking import IndexedTerm

MARK = "**"  # around matching words
MOST = 32  # words


class Snippet(NamedTuple):
    """A part of a text in one line, "…" where more stands; `marks` are (first character, words) in
    the text of what is marked in it.
    """

    text: str
    marks: list[tuple[int, int]]


class _Span(NamedTuple):
    """Words that match a term: the first, one past the last, the number of the term."""

    first: int
    after: int
    term: int


def snippet(text: str, analyzer: TextAnalyzer, marked: Sequence[IndexedTerm]) -> Snippet:
    """The MOST words with the longest of the terms, then with the most different ones, then with
    the most marks, then the first; without any the beginning.
    """
    tokens = analyzer.pre_tokenize(text).tokens
    words = [token.text for token in tokens]
    spans = _spans(words, marked)
    begin = _begin(spans, len(words))
    end = min(begin + MOST, len(words))
    shown = [one for one in spans if begin <= one.first and one.after <= end]
    at = tokens[begin].char_offset_from if begin else 0
    last = tokens[end - 1].char_offset_to if end < len(words) else len(text)
    assert last is not None
    parts = []
    for one in shown:
        first, after = tokens[one.first].char_offset_from, tokens[one.after - 1].char_offset_to
        assert after is not None
        parts += [text[at:first], MARK, text[first:after], MARK]
        at = after
    marked_text = "".join(["…" * (begin > 0), *parts, text[at:last], "…" * (end < len(words))])
    marks = [(tokens[one.first].char_offset_from, one.after - one.first) for one in shown]
    return Snippet(" ".join(marked_text.split()), marks)


def _spans(words: Sequence[str], marked: Sequence[IndexedTerm]) -> list[_Span]:
    """Where the terms stand, none inside of another: the first, and of these the longest."""
    spans = []
    for number, one in enumerate(marked):
        spans += [_Span(at, at + len(one.words), number) for at in one.places(words)]
    kept: list[_Span] = []
    for span in sorted(spans, key=lambda one: (one.first, -one.after)):
        if not kept or span.first >= kept[-1].after:
            kept.append(span)
    return kept


def _begin(spans: Sequence[_Span], count: int) -> int:
    """The first word of the best part, what is marked in the middle of it."""
    best, begin = (0, 0, 0), 0
    for one in spans:
        near = [two for two in spans if two.first >= one.first and two.after <= one.first + MOST]
        longest = max((two.after - two.first for two in near), default=0)
        worth = longest, len({two.term for two in near}), len(near)
        if near and worth > best:
            best = worth
            begin = one.first - (MOST - (near[-1].after - one.first)) // 2
    return max(0, min(begin, count - MOST))
