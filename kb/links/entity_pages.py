"""Finds the wiki page of each entity by its title, else by its redirects.

Titles and redirects are compared whole, folded as keywords are (case, punctuation, spaces). Of
several pages that one leads to wins, in this order: the title is the entity's name; a redirect is;
the title is without what stands in brackets behind it; then the same for the entity's other forms.
Of equals one that is written as the entity is, then the smallest id.
"""

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from kb.pairs.keywords import EXCLUDED, Keywords
from kb.pairs.matching import phrase

TITLE, ALIAS = "title", "alias"
_BRACKETS = re.compile(r"\s*\([^()]*\)$")


class Names(NamedTuple):
    """What the wiki calls a page: its title without its namespace, and redirects without theirs."""

    title: str
    redirects: tuple[str, ...] = ()


class Own(NamedTuple):
    """An entity's own page: `how` it bears the name, `names` of its titles and redirects do."""

    page_id: int
    how: str
    names: int


class _Claim(NamedTuple):
    """Why a page may be an entity's own; the smallest one wins."""

    form: bool  # not the name, another form
    way: int  # title, redirect, title without brackets
    spelt: bool  # not as the entity is
    page_id: int
    names: int


def own_pages(
    keywords: Keywords, pages: Iterable[tuple[int, str]], names: Mapping[str, Names]
) -> dict[int, Own]:
    """Entities (by number) that have a page of their own. `pages` are ids and titles; `names` says
    by title what else they are called.
    """
    owners = dict(zip(keywords.phrases, keywords.of, strict=True))
    first = [phrase(keyword.name) for keyword in keywords.every]
    best: dict[int, _Claim] = {}
    for page_id, title in pages:
        known = names.get(title, Names(title))
        claims: dict[int, _Claim] = {}
        for way, name in (
            (0, known.title),
            *((1, redirect) for redirect in known.redirects),
            (2, _BRACKETS.sub("", known.title)),
        ):
            folded = phrase(name)
            number = owners.get(folded, EXCLUDED)
            if number == EXCLUDED or (way == 2 and name == known.title):
                continue
            form, spelt = folded != first[number], name != keywords.every[number].name
            claim = _Claim(form, way, spelt, page_id, 1)
            known_claim = claims.get(number)
            if known_claim is not None:
                claim = min(claim, known_claim)._replace(names=known_claim.names + 1)
            claims[number] = claim
        for number, claim in claims.items():
            best[number] = min(best.get(number, claim), claim)
    return {
        number: Own(one.page_id, ALIAS if one.form or one.way == 1 else TITLE, one.names)
        for number, one in sorted(best.items())
    }


def aliases(keywords: Keywords) -> list[list[str]]:
    """The other forms of each entity, sorted."""
    other_forms: list[list[str]] = [[] for _ in keywords.every]
    first = [phrase(keyword.name) for keyword in keywords.every]
    for form, number in zip(keywords.phrases, keywords.of, strict=True):
        if number != EXCLUDED and form != first[number]:
            other_forms[number].append(form)
    return [sorted(forms) for forms in other_forms]
