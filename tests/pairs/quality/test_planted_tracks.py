"""Errors planted in caption tracks are seen in what the client reads, in twenty worlds: times of
words, misheard keywords, tracks that are off.
"""

import math
from difflib import SequenceMatcher
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from kb.pairs.matching import Matcher, phrase
from kb.pairs.transcript_batch import Text
from kb.sandbox.world import World
from kb.sandbox.youtube import web
from kb.sandbox.youtube.cases import Track
from kb.sandbox.youtube.uploads import Video
from kb.youtube.ytdlp.subtitles import Cue, read

SEEDS = range(20)


class BothTracks(NamedTuple):
    """Keywords of a world's videos with both tracks: how many each has, how many they share in
    order, and by how much the measured offset misses the planted one (s, of each video).
    """

    world: World
    automatic: int
    manual: int
    shared: int
    misses: list[float]


@pytest.fixture(scope="module")
def worlds() -> list[World]:
    return [World(seed, n_channels=9, n_videos=100) for seed in SEEDS]


@pytest.fixture(scope="module")
def tracks(worlds: list[World]) -> list[BothTracks]:
    return [_compared(world) for world in worlds]


def _compared(world: World) -> BothTracks:
    nouns = world.domain.speech.nouns
    matcher = Matcher([phrase(noun.name) for noun in nouns])
    shifts = {one["video_id"]: one["shift_s"] for one in world.truth["shifted"]}
    totals, misses = np.zeros(3, int), []
    for video in world.youtube.videos.values():
        if world.youtube.planted.own_kinds(video) == {"", "asr"}:
            (heard, at), (written, later) = (_keywords(world, video, matcher, k) for k in _KINDS)
            blocks = SequenceMatcher(None, heard, written, autojunk=False).get_matching_blocks()
            pairs = [(one.a + n, one.b + n) for one in blocks for n in range(one.size)]
            totals += (len(heard), len(written), len(pairs))
            offset = np.median([later[b] - at[a] for a, b in pairs])
            misses.append(float(offset) - shifts.get(video.id, 0.0))
    return BothTracks(world, *totals.tolist(), misses)


_KINDS = ("asr", "")


def _cues(world: World, video: Video, kind: str) -> list[Cue]:
    return read("srv3", web.srv3(world.youtube.cues(video, Track("en", kind)))).cues


def _keywords(world: World, video: Video, matcher: Matcher, kind: str) -> tuple[list[Any], Any]:
    """The numbers of a track's keywords in order, and when each begins (s)."""
    cues = pa.array([[cue._asdict() for cue in _cues(world, video, kind)]])
    rows = {"video_id": [video.id], "kind": [kind or "manual"], "cues": cues}
    text = Text(pa.table(rows))
    found = matcher.find(text.raw)
    return found.phrase.tolist(), text.time_of(found.start) / 1000


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
        right = 1 - lost - swapped
        inside.append(_wilson_has(right / (1 - lost), one.shared, one.automatic))
        inside.append(_wilson_has(right, one.shared, one.manual))
    assert sum(inside[::2]) >= 0.9 * len(SEEDS)
    assert sum(inside[1::2]) >= 0.9 * len(SEEDS)


def _wilson_has(share: float, hits: int, n: int, z: float = 1.96) -> bool:
    """Whether the 95 % interval of a measured share has the planted one (Wilson 1927)."""
    middle = (hits + z * z / 2) / (n + z * z)
    half = z * math.sqrt(hits * (n - hits) / n + z * z / 4) / (n + z * z)
    return abs(share - middle) <= half


def test_the_planted_offset_is_measured(tracks: list[BothTracks]) -> None:
    """A manual track shares the time of a cue out evenly among its words, so that single
    videos are measured less well.
    """
    misses = [miss for one in tracks for miss in one.misses]
    assert len(misses) >= 60
    assert abs(np.median(misses)) <= 0.1
    assert max(map(abs, misses)) <= 0.3
