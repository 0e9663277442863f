"""Automatic tracks mishear names at the rate that the truth gives, and nothing else."""

from collections import Counter

from kb.core import clock
from kb.sandbox.speech import Noun
from kb.sandbox.world import World
from kb.sandbox.youtube.captions import Rates, SpokenWord, misheard
from kb.sandbox.youtube.cases import Track

NOUNS = [Noun("Iron Sword"), Noun("Iron"), Noun("Kiln")]


def words(text: str) -> list[SpokenWord]:
    return [SpokenWord(float(at), word) for at, word in enumerate(text.split())]


def test_names_are_misheard_as_often_as_said() -> None:
    said = [words("take the iron sword or iron to the kiln today")] * 3_000
    heard, errors = misheard(clock.rng("often"), said, NOUNS, Rates(lost=0.1, swapped=0.05))
    names = Counter(error.keyword for error in errors)
    assert all(abs(names[noun.title] / 3_000 - 0.15) < 0.02 for noun in NOUNS)
    swapped = [error for error in errors if error.other]
    assert abs(len(swapped) / 9_000 - 0.05) < 0.01
    assert all(error.other != error.keyword for error in swapped)
    untouched = [word.text for one in heard for word in one if word.text in ("take", "today")]
    assert len(untouched) == 6_000


def test_words_in_place_of_a_name_share_its_time() -> None:
    said = [words("the iron sword is old")] * 200
    heard, errors = misheard(clock.rng("times"), said, NOUNS, Rates(lost=0.5, swapped=0.5))
    assert len(errors) == 200
    for sentence, error in zip(heard, errors, strict=True):
        assert error.start_s == 1.0
        assert (sentence[0], *sentence[-2:]) == ((0.0, "the"), (3.0, "is"), (4.0, "old"))
        between = sentence[1:-2]
        assert " ".join(word.text for word in between) == error.heard
        assert [word.start for word in between] == sorted(word.start for word in between)
        assert all(1.0 <= word.start < 3.0 for word in between)


def test_the_truth_lists_every_difference_between_two_tracks() -> None:
    world = World(2, n_channels=9, n_videos=80)
    listed = {(one["video_id"], one["start_s"]): one for one in world.truth["hearing"]["errors"]}
    assert len(listed) > 50
    for (video_id, start), error in listed.items():
        video = world.youtube.videos[video_id]
        cues = world.youtube.cues(video, Track("en", "asr"))
        heard = dict(
            pair for cue in cues for pair in zip(cue.word_starts, cue.text.split(), strict=True)
        )
        if error["heard"]:
            assert heard[start] == error["heard"].split()[0]
        else:
            assert start not in heard
