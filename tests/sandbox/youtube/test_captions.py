"""The two kinds of caption tracks of a talk."""

from itertools import pairwise

from kb.core import clock
from kb.sandbox.speech import MUSIC, Sentence
from kb.sandbox.youtube import captions

TALK = [
    Sentence(1.0, 6.0, "hello there, this is about the kiln, the clay and a lot of patience, too"),
    Sentence(8.0, 2.5, MUSIC),
    Sentence(12.0, 2.0, "don't skip it"),
]


def test_every_word_of_an_automatic_track_has_its_time() -> None:
    words = [captions.spoken_words(sentence) for sentence in TALK]
    cues = captions.automatic(clock.rng("cues"), TALK, words)
    assert all(len(cue.word_starts) == len(cue.text.split()) for cue in cues)
    assert all(cue.word_starts[0] == cue.start for cue in cues)
    starts = [start for cue in cues for start in cue.word_starts]
    assert starts == sorted(starts)
    said = " ".join(cue.text for cue in cues)
    assert said.startswith("hello there this is about the kiln the clay")
    assert said.endswith(f"{MUSIC} don't skip it")


def test_cues_of_a_manual_track_follow_each_other() -> None:
    cues = captions.manual(TALK)
    assert [cue.text for cue in cues][1:] == ["too.", MUSIC, "Don't skip it."]
    assert all(one.start + one.duration <= next_.start + 0.001 for one, next_ in pairwise(cues))
    assert not any(cue.word_starts for cue in cues)
