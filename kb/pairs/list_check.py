"""Everything about a profile's keyword lists that can be known without a transcript, row by row.

check_lists(folder, names, section)    what is wrong, and what is allowed but can't be meant
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from kb.core.profile.everyday import is_everyday
from kb.core.profile.finding import ERROR, NOTE, WARNING, Finding
from kb.core.profile.pairs import Pairs
from kb.pairs.fold import phrase
from kb.pairs.forms import forms
from kb.pairs.listed import Row, scan

Placed = tuple[str, Row]  # a row and its file's name


def check_lists(folder: Path, names: Sequence[str], section: Pairs | None) -> list[Finding]:
    """Findings of all lists together. `section` is None where [pairs] itself has errors."""
    near_words = section.near_words if section else Pairs.model_fields["near_words"].default
    every: list[Placed] = []
    found: list[Finding] = []
    for name in names:
        rows, problems = scan(folder / name, near_words)
        every += [(name, row) for row in rows]
        found += [Finding(ERROR, name, one.line, "", one.what, one.mend) for one in problems]
        if not rows and not problems:
            mend = "write one a line: keyword, tab, kind"
            found.append(Finding(ERROR, name, 0, "", "the list holds no keyword", mend))
    broken = bool(found)
    found += _duplicates(every)
    found += _kinds(every)
    found += _everyday(every)
    found += _excluded(every, section)
    if not broken:
        found += _helpless(every, section)
    return found


def _at(level: str, place: Placed, what: str, mend: str) -> Finding:
    return Finding(level, place[0], place[1].line, place[1].keyword.name, what, mend)


def _duplicates(every: list[Placed]) -> Iterator[Finding]:
    """Names that stand twice, and forms that another keyword has as its name or form."""
    first: dict[str, Placed] = {}
    for place in every:
        name = place[1].keyword.name
        before = first.setdefault(phrase(name), place)
        if before is not place:
            what = f"{name!r} stands on line {before[1].line} of {before[0]} already"
            mine, other = place[1].keyword, before[1].keyword
            same = (mine.kind, mine.reach, mine.more) == (other.kind, other.reach, other.more)
            # Only a row that says something else is lost.
            level = NOTE if same else WARNING
            yield _at(level, place, what, "the first counts; take one of them out")
    taken = dict(first)
    for place in every:
        for form in place[1].keyword.more:
            folded = phrase(form)
            if not folded:
                yield _at(WARNING, place, f"the form {form!r} has no word", "take it out")
                continue
            before = taken.setdefault(folded, place)
            if before is not place:
                what = f"the form {form!r} is that of {before[1].keyword.name!r} already"
                yield _at(NOTE, place, what, "a form counts for one keyword only")


def _kinds(every: list[Placed]) -> Iterator[Finding]:
    """A kind that stands once and looks like one that stands often."""
    often = Counter(row.keyword.kind for _, row in every)
    known = [kind for kind, times in often.items() if times >= 3]
    for place in every:
        kind = place[1].keyword.kind
        if often[kind] > 1:
            continue
        close = difflib.get_close_matches(kind, known, n=1, cutoff=0.8)
        if close:
            what = f"the kind {kind!r} stands only here"
            yield _at(WARNING, place, what, f"did you mean {close[0]!r}?")


def _everyday(every: list[Placed]) -> Iterator[Finding]:
    """Single everyday words that count wherever they are said."""
    for place in every:
        keyword = place[1].keyword
        if keyword.reach is not None or keyword.rule == "always":
            continue
        for word in (keyword.name, *keyword.more):
            if is_everyday(word):
                what = f"{word!r} is an everyday word and has no rule"
                mend = (
                    "write near (with another keyword close by), never, or always (it is meant)"
                    " as its rule"
                )
                yield _at(WARNING, place, what, mend)


def _excluded(every: list[Placed], section: Pairs | None) -> Iterator[Finding]:
    """Keywords that `exclude` takes away whole."""
    for text in section.exclude if section else ():
        banned = forms(phrase(text))
        for place in every:
            if phrase(place[1].keyword.name) in banned:
                what = f"{place[1].keyword.name!r} is ruled out by pairs.exclude"
                yield _at(WARNING, place, what, f"take it out here, or {text!r} there")


def _helpless(every: list[Placed], section: Pairs | None) -> Iterator[Finding]:
    """Rules that wait for a keyword which the lists don't have."""
    if not every or (section and section.include):
        return
    if all(row.keyword.reach is not None for _, row in every):
        what = "every keyword has a rule, so that none makes a pair"
        mend = "near waits for a keyword without a rule: leave it empty where a word is yours alone"
        yield _at(ERROR, every[0], what, mend)
