"""The part of a text that says most of what was asked for, with these words marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from tantivy import TextAnalyzer

from kb.search.rank import Found

MARK = "**"  # around the words that were asked for
MOST = 32  # words


class Snippet(NamedTuple):
    """A part of a text in one line, "…" where more stands; `marks` are (first character, words) in
    the text of what is marked in it.
    """

    text: str
    marks: list[tuple[int, int]]


class _Span(NamedTuple):
    """Words that were asked for: first, one past the last, which of the terms."""

    first: int
    after: int
    term: int


def snippet(text: str, analyzer: TextAnalyzer, marked: Sequence[Found]) -> Snippet:
    """The MOST words with the most different terms, of as good ones those with the most marks, then
    the first; without any the beginning.
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
    whole = "".join(["…" * (begin > 0), *parts, text[at:last], "…" * (end < len(words))])
    marks = [(tokens[one.first].char_offset_from, one.after - one.first) for one in shown]
    return Snippet(" ".join(whole.split()), marks)


def _spans(words: Sequence[str], marked: Sequence[Found]) -> list[_Span]:
    """Where the terms stand, none inside of another: the first, and of these the longest."""
    found = []
    for number, one in enumerate(marked):
        found += [_Span(at, at + len(one.words), number) for at in one.places(words)]
    kept: list[_Span] = []
    for span in sorted(found, key=lambda one: (one.first, -one.after)):
        if not kept or span.first >= kept[-1].after:
            kept.append(span)
    return kept


def _begin(spans: Sequence[_Span], count: int) -> int:
    """The first word of the best part, what is marked in the middle of it."""
    best, begin = (0, 0), 0
    for one in spans:
        held = [two for two in spans if two.first >= one.first and two.after <= one.first + MOST]
        worth = len({two.term for two in held}), len(held)
        if worth > best:
            best = worth
            begin = one.first - (MOST - (held[-1].after - one.first)) // 2
    return max(0, min(begin, count - MOST))
