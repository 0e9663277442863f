"""Makes the caption tracks of a talk: the words with their times, and the cues that hold them."""

import random
import re
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

from kb.sandbox.speech import MUSIC, Sentence, sentence_case

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
