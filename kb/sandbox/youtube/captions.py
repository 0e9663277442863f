"""Makes the caption tracks of a talk: the words with their times, and the cues that hold them."""

import random
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

from kb.sandbox.speech import MUSIC, Noun, Sentence, grammar, sentence_case

ROLLING = 1.9  # how long an automatic cue is shown, in times of what is said in it
_WIDEST = 14  # words of a manual cue


class SpokenWord(NamedTuple):
    """A word of an automatic track, and when it begins (s)."""

    start: float
    text: str


class SpokenCue(NamedTuple):
    """A line of a caption track, times in s. `word_starts`: of each word, when it is automatic."""

    start: float
    duration: float
    text: str
    word_starts: tuple[float, ...] = ()


def spoken_words(sentence: Sentence) -> list[SpokenWord]:
    """The words as an automatic track writes them: lower case, without punctuation."""
    text = sentence.text if sentence.text == MUSIC else spoken(sentence.text)
    return _timed(text.split(), sentence)


def automatic(
    rng: random.Random, talk: Sequence[Sentence], words: Sequence[Sequence[SpokenWord]]
) -> list[SpokenCue]:
    """An automatic track with these words in each sentence: five to seven a cue, each cue shown
    until the next but one begins.
    """
    made = []
    for sentence, heard in zip(talk, words, strict=True):
        factor = 1.0 if sentence.text == MUSIC else ROLLING
        for cue, starts in _lines(heard, rng.randint(5, 7), sentence):
            made.append(cue._replace(duration=round(cue.duration * factor, 3), word_starts=starts))
    return made


def manual(talk: Sequence[Sentence]) -> list[SpokenCue]:
    """A manual track: sentences with capitals and stops."""
    made = []
    for sentence in talk:
        text = sentence.text
        written = text if text == MUSIC else f"{sentence_case(text)}."
        words = _timed(written.split(), sentence)
        made += [cue for cue, _ in _lines(words, _WIDEST, sentence)]
    return made


def spoken(text: str) -> str:
    """A text in lower case, without punctuation."""
    return re.sub(r"[^\w\s'%-]", "", text).lower()


def _timed(words: Sequence[str], sentence: Sentence) -> list[SpokenWord]:
    """The words of a sentence with their times: a long word takes longer."""
    ends = list(accumulate(len(word) + 2 for word in words))
    return [
        SpokenWord(round(sentence.start + sentence.seconds * end / ends[-1], 3), word)
        for end, word in zip((0, *ends), words, strict=False)
    ]


def _lines(
    words: Sequence[SpokenWord], size: int, sentence: Sentence
) -> Iterator[tuple[SpokenCue, tuple[float, ...]]]:
    """Cues of so many words, and when these begin."""
    ends = round(sentence.start + sentence.seconds, 3)
    for at in range(0, len(words), size):
        piece = words[at : at + size]
        until = words[at + size].start if at + size < len(words) else ends
        begins = piece[0].start
        cue = SpokenCue(begins, round(until - begins, 3), " ".join(word.text for word in piece))
        yield cue, tuple(word.start for word in piece)


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
                instead = error.heard.split()
                step = (ends - words[at].start) / max(len(instead), 1)
                heard += [
                    SpokenWord(round(words[at].start + step * place, 3), word)
                    for place, word in enumerate(instead)
                ]
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
        those.sort(key=lambda edit: -len(edit[0]))
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
    others = [other for other in nouns if other != noun]
    if chance < rates.swapped and others:
        other = rng.choice(others)
        return Mishearing(noun.title, start, spoken(other.name), other.title)
    if chance < rates.swapped + rates.lost:
        heard = rng.choice(["", *grammar().rules["misheard"]])
        return Mishearing(noun.title, start, heard, None)
    return None
