"""BM25 over the indexes of several sources, as if they were one.

    score = Σ rarity · f · (k + 1) / (f + k · (1 - b + b · length / mean))
    rarity = ln(1 + (N - n + 0.5) / (n + 0.5))

with N passages, n that have the term, f how often a passage has it, k = 1.2, b = 0.75; words of the
title count twice, in f and in the length. Lengths are held in one byte: up to 40 words they are
exact, above that the next lower of 42, 44 … 56, 60 … 88, 96 … 152, 168 …; the mean, of the source
alone, is exact. How rare a term is follows from all sources that are searched together, else a
word would count more only because its source is larger: tantivy weighs each term by its own
source, and that is divided out.

What begins like a prefix counts as the best of its words: each of the most frequent ones as if it
were as rare as the prefix is, any other as found once in a passage of mean length. Of a prefix
behind other words only the 256 most frequent ones are looked for, and it is as rare as the rarest
of these others.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from typing import NamedTuple

from tantivy import Occur, Query

from kb.core.errors import UsageError
from kb.search.engine import Address, Opened
from kb.search.words import Question, Term

_BEGINNINGS = 64  # words of a prefix that count as often as they are found
_SIDE_BY_SIDE = 256  # words of a prefix that are looked for behind others
_MARKED = 0.3  # of the rarest term's rarity
_DIGITS = 5  # of a score; the engine computes with seven
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
    """A passage's score and where it is. Sorts from the best."""

    minus: float
    source: str
    place: Address

    @property
    def score(self) -> float:
        """BM25; the higher the better."""
        return -self.minus


class Found:
    """A term in one index. `words` are its words as the index has them."""

    def __init__(self, index: Opened, term: Term) -> None:
        self._index, self._prefix = index, term.prefix
        self.words = index.analyzer.analyze(term.text)

    @cached_property
    def _every(self) -> list[list[str]]:
        """The term's words; of a prefix those of the most frequent words that it may stand for."""
        if not self._prefix or not self.words:
            return [self.words] if self.words else []
        *before, last = self.words
        most = _SIDE_BY_SIDE if before else _BEGINNINGS
        return [[*before, one] for one in self._index.beginning(last, most)]

    @cached_property
    def having(self) -> int:
        """How many passages have the term; of several words with a prefix, at most how many."""
        if not self._every:
            return 0
        if len(self._every) == 1 and len(self.words) == 1:
            return self._index.having(self._every[0][0])
        if self._prefix and len(self.words) > 1:  # to count them takes as long as to ask
            return min(map(self._index.having, self.words[:-1]))
        return self._index.count(self.query(1.0))

    def places(self, words: Sequence[str]) -> list[int]:
        """Where the term stands among the words of a text."""
        first, *rest = self.words or [""]
        if not rest and self._prefix:
            return [at for at, word in enumerate(words) if word.startswith(first)]
        places = [at for at, word in enumerate(words) if word == first]
        return [at for at in places if self._goes_on(words[at + 1 : at + 1 + len(rest)], rest)]

    def _goes_on(self, words: Sequence[str], rest: Sequence[str]) -> bool:
        if not self._prefix or len(words) < len(rest):
            return words == rest
        return words[:-1] == rest[:-1] and words[-1].startswith(rest[-1])

    def query(self, rarity: float) -> Query:
        """Passages with the term, scored as one that is so rare. There have to be some."""
        parts = [
            Query.boost_query(self._index.words(words), rarity / self._own_rarity(words))
            for words in self._every
        ]
        if len(self.words) == 1 and len(parts) >= _BEGINNINGS:
            parts.append(Query.const_score_query(self._index.like(self.words[0]), rarity))
        return parts[0] if len(parts) == 1 else Query.disjunction_max_query(parts)

    def _own_rarity(self, words: list[str]) -> float:
        """What tantivy weighs these words with."""
        index = self._index
        return sum(rarity(index.size, index.having(word)) for word in words)


class Weighed(NamedTuple):
    """A question's terms that decide, the rarest first, with their rarity; and each of the
    question's terms in each index.
    """

    rarities: dict[Term, float]
    found: dict[str, dict[Term, Found]]

    def marked(self, source: str) -> list[Found]:
        """What a snippet marks: without words that are everywhere, such as "to"."""
        most = max(self.rarities.values(), default=0.0)
        told = [term for term, one in self.rarities.items() if one >= _MARKED * most]
        return [self.found[source][term] for term in told]


def weigh(indexes: Mapping[str, Opened], question: Question) -> Weighed:
    """How much each term counts in these indexes; one that is nowhere is left out."""
    every = dict.fromkeys((*question.terms, *question.needed, *question.barred))
    found = {
        source: {term: Found(index, term) for term in every} for source, index in indexes.items()
    }
    whole = sum(index.size for index in indexes.values())
    counts = {term: sum(one[term].having for one in found.values()) for term in question.terms}
    told = {term: rarity(whole, count) for term, count in counts.items() if count}
    return Weighed(dict(sorted(told.items(), key=lambda one: (-one[1], one[0]))), found)


def rank(
    indexes: Mapping[str, Opened],
    question: Question,
    weighed: Weighed,
    only: Only,
    linked: Mapping[str, Collection[str]] | None = None,
) -> list[Ranked]:
    """The best passages of all indexes, at most `only.limit`, the best first; of equal ones in
    the order of sources and of writing. `linked`: those alone that have one of these keys.
    """
    ranked: list[Ranked] = []
    for source, index in indexes.items():
        keys = None if linked is None else linked[source]
        query = _query(index, weighed.found[source], question, weighed, only, keys)
        if query is not None:
            ranked += (Ranked(-score, source, place) for score, place in _best(index, query, only))
    return sorted(ranked)[: only.limit]


def rarity(passages: int, having: int) -> float:
    """How much a term counts that `having` of the passages have; never below nought."""
    return math.log(1 + (passages - having + 0.5) / (having + 0.5))


def _query(
    index: Opened,
    found: Mapping[Term, Found],
    question: Question,
    weighed: Weighed,
    only: Only,
    keys: Collection[str] | None,
) -> Query | None:
    """What an index is asked; None where it can have no answer."""
    needed = [term for term in question.needed if found[term].words]
    if not all(found[term].having for term in needed):
        return None
    scored: list[tuple[Occur, Query]] = [
        (Occur.Must if term in needed else Occur.Should, found[term].query(one))
        for term, one in weighed.rarities.items()
        if found[term].having
    ]
    if not scored:
        return None
    filters: list[tuple[Occur, Query]] = []
    if only.kinds:
        filters.append((Occur.Must, index.kinds(only.kinds)))
    if only.since or only.until:
        filters.append((Occur.Must, index.days(only.since, only.until)))
    if keys is not None:
        filters.append((Occur.Must, index.keys(keys)))
    for term in needed:
        if term not in weighed.rarities:  # of too many
            filters.append((Occur.Must, found[term].query(1.0)))
    filters = [(sign, Query.const_score_query(one, 0.0)) for sign, one in filters]
    for term in question.barred:
        if found[term].having:
            filters.append((Occur.MustNot, found[term].query(1.0)))
    asked = Query.boolean_query(scored)
    return Query.boolean_query([(Occur.Must, asked), *filters]) if filters else asked


def _best(index: Opened, query: Query, only: Only) -> list[tuple[float, Address]]:
    most = only.limit if only.each is None else max(_AHEAD, 4 * only.limit)
    while True:
        most = min(most, index.size)
        hits = index.best(query, most)
        found: list[tuple[float, Address]] = []
        taken: Counter[int] = Counter()
        for exact, place, thing in hits:
            taken[thing] += 1
            score = round(exact, _DIGITS)
            if score >= only.least and (only.each is None or taken[thing] <= only.each):
                found.append((score, place))
        enough = len(found) >= only.limit or len(hits) < most or most == index.size
        if enough or round(hits[-1][0], _DIGITS) < only.least:
            return found[: only.limit]
        most *= 8
