"""BM25 over the indexes of several sources, as if they were one.

FTS5 reckons each passage's part of a term from the term's frequency in it, weighted by field, and
its length beside the mean of its source; how rare a term is follows here from all sources that are
searched together, else a word would count more only because its source is larger:

    score = Σ rarity · f · (k + 1) / (f + k · (1 - b + b · length / mean))
    rarity = ln(1 + (N - n + 0.5) / (n + 0.5))

with N passages, n that have the term, f = Σ weight · frequency by field, k = 1.2, b = 0.75. A plain
word that stands in more than a fifth of many passages is left out where a rarer one is asked for
too: it would decide nothing, and looking it up would take the longest.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from typing import NamedTuple

from kb.core.errors import UsageError
from kb.search.words import Question, Term
from kb.store.sqlite import Connection

WEIGHTS = {"title": 2.0, "path": 1.5, "text": 1.0, "alt": 0.5}
KEYS = "linked"  # a temporary table beside an index: the keys that alone may be answers
_MANY = 10_000  # passages from which common words are left out
_COMMON = 0.2
_MARKED = 0.3  # of the rarest term's rarity


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
    id: int

    @property
    def score(self) -> float:
        """BM25; the higher the better."""
        return -self.minus


class Weighed(NamedTuple):
    """A question's terms that decide, the rarest first: rarity, and passages that have the term by
    source; `sizes`: passages by source.
    """

    rarities: dict[Term, float]
    having: dict[Term, dict[str, int]]
    sizes: dict[str, int]

    @property
    def marked(self) -> str:
        """What a snippet marks: without words that are everywhere, such as "to"."""
        most = max(self.rarities.values(), default=0.0)
        told = [term.match for term, one in self.rarities.items() if one >= _MARKED * most]
        return " OR ".join(told)


def weigh(indexes: Mapping[str, Connection], question: Question) -> Weighed:
    """How much each term counts in these indexes; one that is nowhere is left out."""
    # They are numbered from 1 on; counting them would read the whole file.
    last = "SELECT coalesce(max(id), 0) FROM passages"
    sizes = {source: _one(con, last) for source, con in indexes.items()}
    having = {
        term: {source: _having(con, term) for source, con in indexes.items()}
        for term in question.terms
    }
    whole = sum(sizes.values())
    counts = {term: count for term in having if (count := sum(having[term].values()))}
    rare = {term: n for term, n in counts.items() if not _is_common(term, n, whole)}
    told = {term: rarity(whole, count) for term, count in (rare or counts).items()}
    by_rarity = sorted(told.items(), key=lambda one: (-one[1], one[0]))
    return Weighed(dict(by_rarity), having, sizes)


def rank(
    indexes: Mapping[str, Connection],
    question: Question,
    weighed: Weighed,
    only: Only,
    *,
    linked: bool = False,
) -> list[Ranked]:
    """The best passages of all indexes, at most `only.limit`, the best first; of equal ones in
    the order of sources and rows. `linked`: those alone whose keys the table KEYS has.
    """
    ranked: list[Ranked] = []
    for source, con in indexes.items():
        factors = {
            term: value / _of_fts5(weighed.sizes[source], count)
            for term, value in weighed.rarities.items()
            if (count := weighed.having[term][source])
        }
        if factors:
            ranked += (
                Ranked(-score, source, number)
                for number, score in _best(con, factors, question, only, linked=linked)
            )
    return sorted(ranked)[: only.limit]


def rarity(passages: int, having: int) -> float:
    """How much a term counts that `having` of the passages have; never below nought."""
    return math.log(1 + (passages - having + 0.5) / (having + 0.5))


def _of_fts5(passages: int, having: int) -> float:
    """What FTS5 takes instead (fts5_aux.c, fts5Bm25GetData), to be divided out."""
    known = math.log((passages - having + 0.5) / (having + 0.5))
    return known if known > 0 else 1e-6


def _is_common(term: Term, having: int, passages: int) -> bool:
    return term.plain and passages >= _MANY and having > _COMMON * passages


def _best(
    con: Connection,
    factors: Mapping[Term, float],
    question: Question,
    only: Only,
    *,
    linked: bool,
) -> list[tuple[int, float]]:
    weights = ", ".join(str(weight) for weight in WEIGHTS.values())
    values: list[str | float | int] = []
    parts = []
    for number, (term, factor) in enumerate(factors.items()):
        parts.append(
            f"hits{number} AS MATERIALIZED (SELECT rowid AS id, -bm25(found, {weights}) * ? AS part"
            " FROM found WHERE found MATCH ?)"
        )
        values += [factor, term.match]
    every = " UNION ALL ".join(f"SELECT id, part FROM hits{n}" for n in range(len(factors)))
    where = ["score >= ?"]
    bounds: list[str | float | int] = [only.least]
    has = "(SELECT rowid FROM found WHERE found MATCH ?)"
    for sign, matches in (("IN", question.needed), ("NOT IN", question.barred)):
        where += [f"id {sign} {has}"] * len(matches)
        bounds += matches
    sql = f"""
        WITH {", ".join(parts)},
        scored AS (SELECT id, round(sum(part), 6) AS score FROM ({every}) GROUP BY id)
        SELECT id, score FROM scored WHERE {" AND ".join(where)} ORDER BY score DESC, id"""
    return _first(con, con.execute(sql, [*values, *bounds]), only, linked=linked)


def _first(
    con: Connection, scored: Iterable[tuple[int, float]], only: Only, *, linked: bool
) -> list[tuple[int, float]]:
    """The first that may be answers. What a passage is of is looked up for these alone: reading it
    for every passage with one of the words would take the longest.
    """
    found: list[tuple[int, float]] = []
    taken: Counter[str] = Counter()
    keys = {key for (key,) in con.execute(f"SELECT key FROM {KEYS}")} if linked else set()
    for number, score in scored:
        sql = "SELECT key, thing, kind, date FROM passages WHERE id = ?"
        key, thing, kind, day = con.execute(sql, [number]).fetchone()
        if linked and key not in keys:
            continue
        if only.kinds and kind not in only.kinds:
            continue
        if (only.since or only.until) and day is None:
            continue
        if (only.since and day < only.since) or (only.until and day > only.until):
            continue
        taken[thing] += 1
        if only.each is not None and taken[thing] > only.each:
            continue
        found.append((number, score))
        if len(found) == only.limit:
            break
    return found


def _having(con: Connection, term: Term) -> int:
    return _one(con, "SELECT count(*) FROM found WHERE found MATCH ?", term.match)


def _one(con: Connection, sql: str, *values: str) -> int:
    return int(con.execute(sql, values).fetchone()[0])
