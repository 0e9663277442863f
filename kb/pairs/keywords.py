"""The profile's keywords: forms, kinds, and rules for everyday words.

A list is a tab-separated file with the columns `keyword`, `kind`, `rule`, `forms`; lines that begin
with # are comments. Plural and joined forms follow by rule (kb.pairs.keyword_list);
`forms` adds others, separated by commas. A rule says what an everyday word ("bed", "chest")
needs to count:

    topic      a video whose topic is known (by its game's label, or an imported video that the
               profile takes as meant); elsewhere the same as near
    near       an unmistakable keyword within the profile's `near_words`
    near:30    the same within 30 words
    never      nothing helps: the word is counted, and makes no pair
    always     nothing: it counts wherever it is said, as with an empty rule, and is meant so

Of equal forms a keyword's own name wins over forms that follow by rule, then the earlier line.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import pyarrow as pa

from kb.core.cached_property import cached_property
from kb.core.config.profile import Profile
from kb.core.config.profile.products import Pairs
from kb.core.errors import ProfileError
from kb.core.installation import np
from kb.pairs.keyword_list import (
    COLUMNS,
    LONGEST,
    NEVER,
    Keyword,
    alternatives,
    forms,
    numbers,
    read_keywords,
)
from kb.pairs.matching import Matcher, phrase

__all__ = [
    "COLUMNS",
    "EXCLUDED",
    "NEVER",
    "Keyword",
    "Keywords",
    "load",
    "make_keywords",
    "of_plain",
    "plain",
    "read_keywords",
]

EXCLUDED = -1


@dataclass(frozen=True)
class Keywords:
    """Keywords and the folded phrases that stand for them;
    `of` gives a phrase's keyword or EXCLUDED.
    """

    every: tuple[Keyword, ...]
    phrases: tuple[str, ...]
    of: tuple[int, ...]

    @cached_property
    def certain(self) -> np.ndarray:
        """Which keywords need no other."""
        return np.asarray([keyword.reach is None for keyword in self.every], bool)

    @cached_property
    def topical(self) -> np.ndarray:
        """Which keywords need no other in a video whose topic is known."""
        return np.asarray([keyword.rule == "topic" for keyword in self.every], bool)

    @cached_property
    def reach(self) -> np.ndarray:
        """Words within which the others need a certain one; NEVER for those that no other helps."""
        return np.asarray([keyword.reach or 0 for keyword in self.every], np.int64)

    @cached_property
    def owner(self) -> np.ndarray:
        return np.asarray(self.of, np.int64)

    @cached_property
    def matcher(self) -> Matcher:
        return Matcher(self.phrases)

    @cached_property
    def names(self) -> pa.Array[Any]:
        return pa.array([keyword.name for keyword in self.every], pa.string())


def plain(keywords: Keywords) -> dict[str, Any]:
    """Keywords as JSON has them, for plans that workers read."""
    return {
        "every": [
            [keyword.name, keyword.kind, keyword.reach, keyword.rule == "topic"]
            for keyword in keywords.every
        ],
        "phrases": keywords.phrases,
        "of": keywords.of,
    }


def of_plain(data: dict[str, Any]) -> Keywords:
    """The keywords that `plain` wrote."""
    every = tuple(
        Keyword(name, kind, reach, rule="topic" if topical else "")
        for name, kind, reach, topical in data["every"]
    )
    return Keywords(every, tuple(data["phrases"]), tuple(data["of"]))


def load(profile: Profile) -> Keywords:
    """The keywords of [pairs]. Raises ProfileError naming the file and line."""
    section = profile.section(Pairs)
    listed = [
        keyword
        for name in section.keyword_files
        for keyword in read_keywords(profile.resolve_file(name), section.near_words)
    ]
    listed += [Keyword(" ".join(text.split()), "phrase") for text in section.include]
    return make_keywords(listed, section.exclude, f"profile {profile.path}")


def make_keywords(
    listed: list[Keyword], exclude: tuple[str, ...] | list[str] = (), where: str = "the list"
) -> Keywords:
    """Keywords with all their forms.

    Raises ProfileError when a name has no word or there are none.
    """
    every: dict[str, Keyword] = {}
    for keyword in listed:
        folded = phrase(keyword.name)
        if not folded or len(folded) > LONGEST:
            raise ProfileError(
                f"{where}: the keyword {keyword.name!r} has"
                f" {'no word' if not folded else 'too many letters'}"
            )
        every.setdefault(folded, keyword)
    excluded = (phrase(alternative) for text in exclude for alternative in alternatives(text))
    banned = {form for text in excluded for form in forms(text) if form}
    names = [name for name in every if name not in banned]
    owner: dict[str, int] = {name: index for index, name in enumerate(names)}
    for index, name in enumerate(names):
        for extra in every[name].more:
            owner.setdefault(phrase(extra), index)
    for index, derived in enumerate(_forms(tuple(names))):
        for form in derived:
            owner.setdefault(form, index)
    for index, name in enumerate(names):
        for extra in every[name].more:
            for form in sorted(numbers(phrase(extra))):
                owner.setdefault(form, index)
    owner.pop("", None)
    owner.update(dict.fromkeys(banned, EXCLUDED))
    if not names:
        raise ProfileError(f"{where}: there are no keywords to match")
    ordered = sorted(owner)
    return Keywords(
        tuple(every[name] for name in names), tuple(ordered), tuple(owner[form] for form in ordered)
    )


@lru_cache(maxsize=2)  # pairs and links of one command have the same
def _forms(names: tuple[str, ...]) -> list[list[str]]:
    """The forms of each name, sorted."""
    known = {word for name in names for word in name.split(" ")}
    return [sorted(forms(name, known)) for name in names]
