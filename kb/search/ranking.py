"""tantivy's BM25 over the indexes of several sources, and words in the order asked above it.

    score  = Σ rarity · f · (k + 1) / (f + k · (1 - b + b · length / mean)) + order
    rarity = ln(1 + (N - n + 0.5) / (n + 0.5))

with N passages, n that have the term, f how often a passage has it, k = 1.2, b = 0.75; words of the
title count twice, in f and in the length. The mean is that of the source. How rare a term is
follows from all sources that are searched together, else a word would count more only because its
source is larger: tantivy weighs each term by its own source, and that is divided out. What begins
like a prefix counts once, as if all such words were one.

`order`: for each two neighbours of the words asked that a passage has side by side, the mean of
their rarities; where it has all that are not small in the order asked, with the same gaps give or
take a word, more than all this can sum up to; and where it has all of them side by side, as much
again. So such passages rank above all that only share the words.

Passages of a thing whose title is the question come before them. A question's words that only ask
("how do I make …") are not part of what it is about: a page is also found by its title among the
words, and counts for the share of them that its title has, by their rarities.
"""

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import NamedTuple

from tantivy import Occur, Query

from kb.core.errors import UsageError
from kb.search.query import MOST, Question, Term, function_words, question
from kb.search.tantivy_index import PassageIndex

_HIGHEST = 2.2  # k + 1: what a term adds at most, as a multiple of its rarity
_TITLE = 3  # times `order`: above all that words can sum up to
_PAGE = 1.02  # of two things with the title, the page comes first
_EVERY = 1.1  # where the title has all words of the question, small ones too
_LONGEST = 8  # words of a title within a question
_MARKED = 0.3  # of the rarest term's rarity
_DIGITS = 3  # of a score; the engine computes with seven in all
_AHEAD = 64  # passages that are looked at first, as several may be of one thing


@dataclass(frozen=True)
class Only:
    """Which passages may be answers, and how many: `each` of one video, page or thread (None: all
    of them); dates as "2026-03-01", both included.
    """

    kinds: tuple[str, ...] = ()
    since: str = ""
    until: str = ""
    least: float = 0.0
    each: int | None = 1
    limit: int = 10


def day_given(name: str, given: str) -> str:
    """A day as somebody wrote it, "" for none. Raises UsageError unless it is like 2023-01-31."""
    try:
        if given and not re.fullmatch(r"\d{4}-\d\d-\d\d", given):
            raise ValueError
        return date.fromisoformat(given).isoformat() if given else ""
    except ValueError:
        raise UsageError(f"{name} is {given!r}", hint="write it like 2023-01-31") from None


class Ranked(NamedTuple):
    """A passage's score and where it is. Sorts from the best; equal ones as they were written."""

    minus: float
    source: str
    number: int
    address: tuple[int, int]

    @property
    def score(self) -> float:
        return -self.minus


class IndexedTerm:
    """A term in one index. `words` are its words as the index has them."""

    def __init__(self, index: PassageIndex, term: Term) -> None:
        self._index, self.prefix = index, term.prefix
        self.words: list[str] = index.analyzer.analyze(term.text)

    @property
    def frequencies(self) -> list[int]:
        """How many passages have each of the words; of a prefix how many have all of it."""
        if self.prefix and self.words:
            return [self._index.count(self._matching)]
        return [self._index.frequency(word) for word in self.words]

    @property
    def _matching(self) -> Query:
        index = self._index
        return index.beginning(self.words) if self.prefix else index.phrase(self.words)

    def places(self, words: Sequence[str]) -> list[int]:
        """Where the term stands among the words of a text."""
        size = len(self.words)
        places = []
        for at in range(len(words) - size + 1) if size else ():
            last = words[at + size - 1]
            ends = last.startswith(self.words[-1]) if self.prefix else last == self.words[-1]
            if ends and list(words[at : at + size - 1]) == self.words[:-1]:
                places.append(at)
        return places

    def scored(self, weight: float) -> Query:
        """Passages with the term, by BM25 as if it were so rare."""
        if self.prefix:
            return self.constant(weight)
        own = sum(rarity(self._index.size, count) for count in self.frequencies)
        return Query.boost_query(self._matching, weight / own)

    def constant(self, score: float) -> Query:
        """Passages with the term, each with this score."""
        return Query.const_score_query(self._matching, score)


class Weights:
    """The weight of each term of a question over all these indexes together."""

    def __init__(self, indexes: Mapping[str, PassageIndex], question: Question) -> None:
        self._size = sum(index.size for index in indexes.values())
        self._unknown: set[str] = set()
        run = Term(" ".join(question.run))
        self.indexed = {
            source: {
                term: IndexedTerm(index, term)
                for term in {*question.terms, *question.needed, *question.barred, *question.pairs}
            }
            for source, index in indexes.items()
        }
        self.runs = {source: IndexedTerm(index, run) for source, index in indexes.items()}
        self.large = {source: _large(index, question) for source, index in indexes.items()}
        self.terms = self._rarities(question.terms)
        pairs = self._rarities(question.pairs)
        self.pairs = {term: both / 2 for term, both in pairs.items()}
        self.order = _HIGHEST * sum(self.terms.values()) + sum(self.pairs.values())

    def _rarities(self, terms: Iterable[Term]) -> dict[Term, float]:
        """Sums over each term's words; a term that the analyzer drops is left out."""
        made = {}
        for term in terms:
            frequencies = [terms_of[term].frequencies for terms_of in self.indexed.values()]
            if all(frequencies):
                counts = [sum(of_word) for of_word in zip(*frequencies, strict=True)]
                made[term] = sum(rarity(self._size, count) for count in counts)
                if min(counts) == 0:
                    self._unknown.add(term.text)
        return made

    def titles(self, index: PassageIndex, question: Question) -> list[Query]:
        """Passages of what is named in the question, each with its score: pages by the share that
        their title has of what it is about, other things by all of it.
        """
        if any(term.prefix for term in question.terms):
            return []
        words = question.run[:MOST] or tuple(term.text for term in question.terms)
        large = tuple(word for word in words if word not in question.small) or words
        subject = self._subject(question, large)
        about = tuple(word for word in words if word in subject)
        weights = {word: self.terms.get(Term(word), 1.0) for word in subject}
        # (words of a title, its share of what the question is about): of a page, of another thing
        of_pages = [
            (span, sum(weights[word] for word in weights.keys() & {*span}) / sum(weights.values()))
            for span in {*_spans(words), *_spans(large)}
        ]
        of_others = [(about, 1.0), (large, 1.0), (words, _EVERY)]
        shares = [(title, share * _PAGE, True) for title, share in [*of_pages, *of_others]]
        shares += [(title, share, False) for title, share in of_others]
        return [
            Query.const_score_query(named, share * _TITLE * self.order)
            for title, share, is_page in shares
            if share and (named := index.named(title, pages=is_page)) is not None
        ]

    def _subject(self, question: Question, large: Sequence[str]) -> set[str]:
        """The words that say what a question is about: those that are known and do not only ask;
        all of them where there are no such words.
        """
        known = {word for word in large if not question.is_asking(word)} - self._unknown
        return known or {*large}

    def marked(self, source: str) -> list[IndexedTerm]:
        """What a snippet marks: all words in the order asked, then those that are not everywhere,
        such as "to", the rarest first.
        """
        most = max(self.terms.values(), default=0.0)
        rarest = sorted(self.terms.items(), key=lambda item: (-item[1], item[0]))
        terms = [self.indexed[source][term] for term, rare in rarest if rare >= _MARKED * most]
        return [self.runs[source], *terms] if self.runs[source].words else terms


def rank(
    indexes: Mapping[str, PassageIndex],
    question: Question,
    weights: Weights,
    only: Only,
    linked: Mapping[str, Collection[str]] | None = None,
) -> list[Ranked]:
    """The best passages of all indexes, at most `only.limit`, the best first; of equal ones in
    the order of sources and of writing. `linked`: only those that have one of these keys.
    """
    ranked: list[Ranked] = []
    if not weights.terms:
        return []
    for source, index in indexes.items():
        if not index.size:
            continue
        keys = None if linked is None else linked[source]
        query = _query(index, source, question, weights, only, keys)
        ranked += _best(index, source, query, only)
    return sorted(ranked)[: only.limit]


def understood(indexes: Mapping[str, PassageIndex], text: str) -> Question:
    """The question in a text, by the function words of the indexes' language. A word that names a
    page is none ("fire"). Raises UsageError without a word to look for.
    """
    listed = frozenset[str]().union(*(function_words(index.language) for index in indexes.values()))

    def is_small(word: str) -> bool:
        return word in listed and not any(
            index.named([word], pages=True) for index in indexes.values()
        )

    return question(text, is_small)


def _spans(words: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Words side by side that may be a title."""
    for first in range(len(words)):
        for after in range(first + 1, min(first + _LONGEST, len(words)) + 1):
            yield tuple(words[first:after])


def rarity(passages: int, having: int) -> float:
    """How much a term counts that `having` of the passages have; never below nought."""
    return math.log(1 + (passages - having + 0.5) / (having + 0.5))


def _large(index: PassageIndex, question: Question) -> list[tuple[int, str]]:
    """Words of the run that are not small, as the index has them, with their places in it."""
    placed: list[tuple[int, str]] = []
    place = 0
    for word in question.run:
        analyzed = index.analyzer.analyze(word)
        if word not in question.small:
            placed += enumerate(analyzed, place)
        place += len(analyzed)
    return placed


def _query(
    index: PassageIndex,
    source: str,
    question: Question,
    weights: Weights,
    only: Only,
    keys: Collection[str] | None,
) -> Query:
    terms, run = weights.indexed[source], weights.runs[source]
    parts = [(Occur.Should, terms[term].scored(weight)) for term, weight in weights.terms.items()]
    parts += [
        (Occur.Should, terms[term].constant(weight)) for term, weight in weights.pairs.items()
    ]
    if run.words:
        parts.append((Occur.Should, run.constant(weights.order)))
    if len(large := weights.large[source]) > 1:
        in_order = Query.const_score_query(index.in_order(large), weights.order)
        parts.append((Occur.Should, in_order))
    if titles := weights.titles(index, question):
        parts.append((Occur.Should, Query.disjunction_max_query(titles)))
    needed, barred = (
        [terms[term].constant(0.0) for term in given if terms[term].words]
        for given in (question.needed, question.barred)
    )
    if only.kinds:
        needed.append(index.kinds(only.kinds))
    if only.since or only.until:
        needed.append(index.days(only.since, only.until))
    if keys is not None:
        needed.append(index.keys(keys))
    return Query.boolean_query(
        [
            (Occur.Must, Query.boolean_query(parts)),
            *((Occur.Must, Query.const_score_query(query, 0.0)) for query in needed),
            *((Occur.MustNot, query) for query in barred),
        ]
    )


def _best(index: PassageIndex, source: str, query: Query, only: Only) -> list[Ranked]:
    most = only.limit if only.each is None else max(_AHEAD, 4 * only.limit)
    while True:
        most = min(most + 1, index.size)
        hits = [(round(hit.score, _DIGITS), hit) for hit in index.best(query, most)]
        last = -1.0 if len(hits) < most or most == index.size else hits[-1][0]
        # Of those with the lowest score some may be left out, and which is chance.
        sure = sorted((-score, hit.number, hit) for score, hit in hits if score > last)
        best: list[Ranked] = []
        taken: Counter[int] = Counter()
        for minus, number, hit in sure:
            taken[hit.thing] += 1
            if -minus >= only.least and (only.each is None or taken[hit.thing] <= only.each):
                best.append(Ranked(minus, source, number, hit.address))
        if len(best) >= only.limit or last < only.least:
            return best[: only.limit]
        most *= 8
