"""Makes the errors of speech recognition: names that an automatic track loses or swaps."""

import random
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from kb.sandbox.speech import Noun, grammar
from kb.sandbox.youtube.captions import SpokenWord, spoken


class Rates(NamedTuple):
    """Shares of the names said that an automatic track loses, or swaps for another name."""

    lost: float
    swapped: float


class Mishearing(NamedTuple):
    """A name that an automatic track doesn't have. `heard`: the words in its place, "" for none;
    `other`: the name that these are.
    """

    keyword: str
    start_s: float
    heard: str
    other: str | None


def misheard(
    rng: random.Random,
    sentences: Sequence[Sequence[SpokenWord]],
    nouns: Sequence[Noun],
    rates: Rates,
) -> tuple[list[list[SpokenWord]], list[Mishearing]]:
    """The words of sentences with some names lost or swapped, and which ones."""
    names = _by_first_word(nouns)
    made: list[list[SpokenWord]] = []
    errors: list[Mishearing] = []
    for words in sentences:
        heard: list[SpokenWord] = []
        at = 0
        while at < len(words):
            noun, size = _name_at(words, at, names)
            error = _error(rng, noun, nouns, rates, words[at].start) if noun else None
            if error:
                ends = words[at + size].start if at + size < len(words) else words[-1].start + 0.3
                heard += _spread(error.heard.split(), words[at].start, ends)
                errors.append(error)
            else:
                heard += words[at : at + size]
            at += size
        made.append(heard)
    return made, errors


def _by_first_word(nouns: Iterable[Noun]) -> dict[str, list[tuple[list[str], Noun]]]:
    """Names by their first word, the longest first."""
    names: dict[str, list[tuple[list[str], Noun]]] = {}
    for noun in nouns:
        words = spoken(noun.name).split()
        if words:
            names.setdefault(words[0], []).append((words, noun))
    for those in names.values():
        those.sort(key=lambda one: -len(one[0]))
    return names


def _name_at(
    words: Sequence[SpokenWord], at: int, names: dict[str, list[tuple[list[str], Noun]]]
) -> tuple[Noun | None, int]:
    """The name that begins at a word, and of how many words it is."""
    for name, noun in names.get(words[at].text, ()):
        if [word.text for word in words[at : at + len(name)]] == name:
            return noun, len(name)
    return None, 1


def _error(
    rng: random.Random, noun: Noun, nouns: Sequence[Noun], rates: Rates, start: float
) -> Mishearing | None:
    chance = rng.random()
    others = [one for one in nouns if one != noun]
    if chance < rates.swapped and others:
        other = rng.choice(others)
        return Mishearing(noun.title, start, spoken(other.name), other.title)
    if chance < rates.swapped + rates.lost:
        heard = rng.choice(["", *grammar().rules["misheard"]])
        return Mishearing(noun.title, start, heard, None)
    return None


def _spread(words: Sequence[str], start: float, end: float) -> list[SpokenWord]:
    """Words one after the other between two times."""
    step = (end - start) / max(len(words), 1)
    return [SpokenWord(round(start + step * at, 3), word) for at, word in enumerate(words)]
