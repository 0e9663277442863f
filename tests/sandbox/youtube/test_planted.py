"""What is planted in the talk is where the truth says, and nowhere else."""

from collections import defaultdict

import pytest

from kb.core import clock
from kb.sandbox.speech import Sentence
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import Track, Video
from kb.sandbox.youtube.planted import FARTHEST, replaced, reworded

TALK = [
    Sentence(0.5, 4.0, "hello everyone and welcome back, today it's all about the kiln"),
    Sentence(5.0, 4.0, "most people often skip the kiln, which took me five days"),
    Sentence(10.0, 4.0, "my first try with the kiln was easy to lose"),
    Sentence(20.0, 4.0, "that's it for the kiln, tell me how it went for you"),
]


@pytest.fixture(scope="module")
def world() -> World:
    return World(5, n_channels=9, n_videos=150)


def said(world: World, video_id: str, start: float, end: float, kind: str) -> str:
    """The cues of a video's track in the domain's language that begin between two times."""
    video = world.youtube.videos[video_id]
    cues = world.youtube.cues(video, Track("en", kind))
    return " ".join(cue.text for cue in cues if start - 0.001 <= cue.start < end)


def test_other_sentences_take_the_place_of_those_that_they_overlap() -> None:
    made = replaced(TALK, 1, ["you are with the small channel of the evening"], "intro")
    assert [one.planted for one in made] == ["", "intro", "", ""]
    assert (made[1].start, made[2:]) == (5.0, TALK[2:])
    assert replaced(TALK, 2, ["a very long word from our partner"] * 9, "sponsor") == TALK


def test_a_copy_has_a_few_words_changed_and_what_is_planted_unchanged() -> None:
    talk = [TALK[0]._replace(planted="intro"), *TALK[1:]]
    made = reworded(clock.rng("copy"), talk)
    changed = [
        (old, new)
        for one, other in zip(talk, made, strict=True)
        for old, new in zip(one.text.split(), other.text.split(), strict=True)
        if old != new
    ]
    assert len(changed) == 2
    assert {old for old, _ in changed} <= {"often", "five", "first"}


def test_copies_are_later_videos_with_nearly_the_same_talk(world: World) -> None:
    assert len(world.truth["copies"]) >= 4
    for pair in world.truth["copies"]:
        copy, original = (world.youtube.videos[pair[key]] for key in ("video_id", "copy_of"))
        assert copy.published_at >= original.published_at
        assert copy.case.stage is original.case.stage is None
        talks = [world.youtube.talk(video, "en") for video in (copy, original)]
        differ = sum(one.text != other.text for one, other in zip(*talks, strict=True))
        assert 0 < differ <= max(2, len(talks[0]) / 4)
    assert len({pair["copy_of"] for pair in world.truth["copies"]}) == len(world.truth["copies"])


def test_a_channels_texts_are_said_word_for_word_in_many_of_its_videos(world: World) -> None:
    videos = defaultdict(set)
    for one in world.truth["recurring"]:
        kinds = world.youtube.planted.own_kinds(world.youtube.videos[one["video_id"]])
        if kinds == {"asr"}:
            heard = said(world, one["video_id"], one["start_s"], one["end_s"], "asr")
            assert heard.split() == one["text"].replace(",", "").lower().split()
        assert len(one["text"].split()) >= 8
        videos[one["channel_id"], one["text"]].add(one["video_id"])
    assert {one["kind"] for one in world.truth["recurring"]} == {"intro", "sponsor"}
    assert min(len(those) for those in videos.values()) >= 3


def test_passages_in_other_languages_are_where_the_truth_says(world: World) -> None:
    marks = {"de": {"ich", "und", "das"}, "es": {"con", "que", "y"}, "fr": {"de", "sur", "en"}}
    passages = world.truth["languages"]
    assert {one["language"] for one in passages} == set(marks)
    for one in passages:
        video = world.youtube.videos[one["video_id"]]
        if kinds(world, video) == {"asr"}:
            text = said(world, video.id, one["start_s"], one["end_s"], "asr")
            assert not set(text.split()) & {"you", "is", "with", "about", "and"}
            assert set(text.split()) & (marks[one["language"]] | {"ihr", "los", "vous", "nous"})


def test_a_manual_track_is_off_by_the_same_time_throughout(world: World) -> None:
    shifts = {one["video_id"]: one["shift_s"] for one in world.truth["shifted"]}
    assert len(shifts) >= 4
    both = [video for video in world.youtube.videos.values() if len(kinds(world, video)) == 2]
    assert shifts.keys() <= {video.id for video in both}
    for video in both:
        shift = shifts.get(video.id, 0.0)
        talk = world.youtube.talk(video, "en")
        starts = {cue.start for cue in world.youtube.cues(video, Track("en"))}
        assert abs(shift) <= FARTHEST
        assert starts >= {round(one.start + shift, 3) for one in talk}
        assert min(starts) >= 0
        assert max(starts) < video.seconds


def kinds(world: World, video: Video) -> set[str]:
    return world.youtube.planted.own_kinds(video)
