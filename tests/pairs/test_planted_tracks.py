"""Errors planted in caption tracks are seen in what the client reads, in twenty worlds: times of
words, misheard keywords, tracks that are off.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from kb.core.summary.intervals import wilson_interval
from kb.pairs.keyword_list import Keyword
from kb.pairs.keywords import Keywords
from kb.pairs.matching import phrase
from kb.pairs.measures import Compared, compare
from kb.pairs.transcript_batch import Text
from kb.sandbox.world import World
from kb.sandbox.youtube import web
from kb.sandbox.youtube.cases import Track, Video
from kb.youtube.ytdlp.subtitles import Cue, read

SEEDS = range(20)


class BothTracks(NamedTuple):
    """Keywords of a world's videos with both tracks, and by how much the measured offset misses
    the planted one (s, of each video).
    """

    world: World
    compared: Compared
    misses: list[float]


@pytest.fixture(scope="module")
def worlds() -> list[World]:
    return [World(seed, n_channels=9, n_videos=100) for seed in SEEDS]


@pytest.fixture(scope="module")
def tracks(worlds: list[World]) -> list[BothTracks]:
    return [_compared(world) for world in worlds]


def _compared(world: World) -> BothTracks:
    names = [noun.name for noun in world.domain.speech.nouns]
    phrases = tuple(map(phrase, names))
    every = tuple(Keyword(name, "noun") for name in names)
    keywords = Keywords(every, phrases, tuple(range(len(names))))
    planted = world.youtube.planted
    both = [one for one in world.youtube.videos.values() if planted.own_kinds(one) == {"", "asr"}]
    compared = compare(*(_text(world, both, kind) for kind in ("asr", "")), keywords)
    shifts = {one["video_id"]: one["shift_s"] for one in world.truth["shifted"]}
    later = [compared.later_s[compared.video == number] for number in range(len(both))]
    misses = [
        float(-np.median(one)) - shifts.get(video.id, 0.0)
        for video, one in zip(both, later, strict=True)
    ]
    return BothTracks(world, compared, misses)


def _text(world: World, videos: list[Video], kind: str) -> Text:
    cues = [[cue._asdict() for cue in _cues(world, video, kind)] for video in videos]
    ids = [video.id for video in videos]
    kinds = [kind or "manual"] * len(ids)
    return Text(pa.table({"video_id": ids, "kind": kinds, "cues": pa.array(cues)}))


def _cues(world: World, video: Video, kind: str) -> list[Cue]:
    return read("srv3", web.srv3(world.youtube.cues(video, Track("en", kind)))).cues


def test_every_word_has_its_time_to_the_millisecond(worlds: list[World]) -> None:
    compared = 0
    for world in worlds:
        for video in world.youtube.videos.values():
            if "asr" in world.youtube.planted.own_kinds(video) and video.seconds < 600:
                said = world.youtube.cues(video, Track("en", "asr"))
                starts = [cue.word_start_s for cue in _cues(world, video, "asr")]
                assert starts == [list(cue.word_starts) for cue in said]
                compared += sum(map(len, starts))
    assert compared > 100_000


def test_the_planted_error_is_inside_the_interval_of_what_is_measured(
    tracks: list[BothTracks],
) -> None:
    inside = []
    for one in tracks:
        lost, swapped = one.world.truth["hearing"]["rates"].values()
        right, found = 1 - lost - swapped, one.compared
        for share, keywords in ((right / (1 - lost), found.automatic), (right, found.manual)):
            low, high = wilson_interval(len(found.both), len(keywords))
            inside.append(low <= share <= high)
    assert sum(inside[::2]) >= 0.9 * len(SEEDS)
    assert sum(inside[1::2]) >= 0.9 * len(SEEDS)


def test_the_planted_offset_is_measured(tracks: list[BothTracks]) -> None:
    """A manual track shares the time of a cue out evenly among its words, so that single
    videos are measured less well.
    """
    misses = [miss for one in tracks for miss in one.misses]
    assert len(misses) >= 60
    assert abs(np.median(misses)) <= 0.1
    assert max(map(abs, misses)) <= 0.3
