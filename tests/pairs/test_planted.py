"""What the sandbox plants in ten worlds is found: reposts, recurring texts, times of words,
misheard keywords, tracks that are off.

The sentences of the invented talk recur too, by chance. So what is found to recur is right where
plain counting says so, and all that is planted has to be among it.
"""

import re
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from kb.core.summary import wilson_interval
from kb.pairs import repeated_text
from kb.pairs.keyword_list import Keyword
from kb.pairs.keywords import Keywords
from kb.pairs.matching import phrase
from kb.pairs.measures import Compared, compare
from kb.pairs.repeated_text import hashed_words
from kb.pairs.transcript_batch import Text
from kb.sandbox.world import World
from kb.sandbox.youtube import web
from kb.sandbox.youtube.cases import Track, Video
from kb.schema import table
from kb.youtube.ytdlp.subtitles import Cue, read
from tests.conftest import needs

needs("rensa")
pytestmark = pytest.mark.slow
SEEDS = range(10)
LENGTH, VIDEOS = 6, 3  # of a recurring run, in words and in videos of a channel


class Served(NamedTuple):
    """A world, and its English tracks as the client reads them: (video id, kind) → cues."""

    world: World
    cues: dict[tuple[str, str], list[Cue]]

    @property
    def videos(self) -> list[Video]:
        return list(self.world.youtube.videos.values())

    @property
    def with_both_tracks(self) -> list[str]:
        return [key for key, kind in self.cues if kind == "asr" and (key, "") in self.cues]

    def text(self, kinds: dict[str, str]) -> Text:
        """The transcripts of these videos, each of its kind."""
        rows = [
            {"video_id": key, "kind": kind or "manual", "cues": [*map(Cue._asdict, cues)]}
            for key, kind in kinds.items()
            for cues in (self.cues[key, kind],)
        ]
        names = ("video_id", "kind", "cues")
        schema = table("youtube/transcripts").arrow()
        return Text(pa.Table.from_pylist(rows, pa.schema([schema.field(name) for name in names])))


class Spoken(NamedTuple):
    """The kept videos of a world and the transcripts that a crawl reads."""

    served: Served
    videos: list[Video]
    text: Text
    words: list[list[str]]  # of each video, by plain splitting


@pytest.fixture(scope="module")
def worlds() -> list[Served]:
    return [_served(World(seed, n_channels=9, n_videos=100)) for seed in SEEDS]


@pytest.fixture(scope="module")
def spoken(worlds: list[Served]) -> list[Spoken]:
    return [_spoken(one) for one in worlds]


def _served(world: World) -> Served:
    cues = {}
    for video in world.youtube.videos.values():
        for kind in world.youtube.planted.own_kinds(video):
            track = web.srv3(world.youtube.cues(video, Track("en", kind)))
            cues[video.id, kind] = read("srv3", track).cues
    return Served(world, cues)


def _spoken(one: Served) -> Spoken:
    own_kinds = one.world.youtube.planted.own_kinds
    videos = [video for video in one.videos if video.case.stage is None and own_kinds(video)]
    kinds = {video.id: min(own_kinds(video)) for video in videos}  # manual before automatic
    plain = [_plain(" ".join(cue.text for cue in one.cues[key])) for key in kinds.items()]
    return Spoken(one, videos, one.text(kinds), plain)


def _plain(text: str) -> list[str]:
    return re.findall(r"[^\W_]+", re.sub(r"\[\w+\]", " ", text.lower()))


def test_reposts_are_found_and_nothing_else(spoken: list[Spoken]) -> None:
    found, planted = set(), set()
    for seed, one in zip(SEEDS, spoken, strict=True):
        video, bands = repeated_text.bands_of(hashed_words(one.text), len(one.text))
        first = repeated_text.firsts(bands)
        numbers = video.tolist()
        for place, (number, of) in enumerate(zip(numbers, first.tolist(), strict=True)):
            if of != place:
                found.add((seed, frozenset((one.videos[number].id, one.videos[numbers[of]].id))))
        copies = one.served.world.truth["copies"]
        planted |= {(seed, frozenset(pair.values())) for pair in copies}
    assert len(planted) >= 20
    assert len(found & planted) >= 0.95 * len(planted)
    assert len(found & planted) >= 0.99 * len(found)


def test_texts_that_recur_are_found_and_nothing_else(spoken: list[Spoken], tmp_path: Path) -> None:
    planted = found_planted = found = right = 0
    for one in spoken:
        marked = _marked(one, tmp_path / "keys.npy")
        recurs = _counted(one)
        for video, words, mark, true in zip(one.videos, one.words, marked, recurs, strict=True):
            assert len(words) == len(mark)
            found, right = found + sum(mark), right + sum(np.logical_and(mark, true))
            for text in one.served.world.truth["recurring"]:
                if text["video_id"] == video.id:
                    said = _plain(text["text"])
                    (at, *_) = (n for n in range(len(words)) if words[n : n + len(said)] == said)
                    planted += len(said)
                    found_planted += sum(mark[at : at + len(said)])
    assert planted > 5_000
    assert found_planted >= 0.9 * planted
    assert right >= 0.95 * found


def _marked(one: Spoken, path: Path) -> list[list[bool]]:
    """Of each video's words, whether they lie in a run that was found to recur."""
    words = hashed_words(one.text)
    keys = repeated_text.keys_of(words, [video.channel.id for video in one.videos])
    np.save(path, repeated_text.once_a_video(keys, words.video[: len(keys)]))
    hits = np.flatnonzero(np.isin(keys, repeated_text.recurring([path])[0]) & (keys != 0))
    mark = np.zeros(len(words.at), bool)
    mark[(hits[:, None] + np.arange(LENGTH)).ravel()] = True
    return [mark[words.video == number].tolist() for number in range(len(one.videos))]


def _counted(one: Spoken) -> list[list[bool]]:
    """The same by counting."""
    videos: dict[tuple[str, ...], set[int]] = defaultdict(set)
    for number, (video, words) in enumerate(zip(one.videos, one.words, strict=True)):
        for at in range(len(words) - LENGTH + 1):
            videos[(video.channel.id, *words[at : at + LENGTH])].add(number)
    made = []
    for video, words in zip(one.videos, one.words, strict=True):
        mark = [False] * len(words)
        for at in range(len(words) - LENGTH + 1):
            if len(videos[(video.channel.id, *words[at : at + LENGTH])]) >= VIDEOS:
                mark[at : at + LENGTH] = [True] * LENGTH
        made.append(mark)
    return made


def test_every_word_has_its_time_to_the_millisecond(worlds: list[Served]) -> None:
    compared = 0
    for one in worlds:
        for video in one.videos:
            if (video.id, "asr") in one.cues and video.seconds < 600:
                said = one.world.youtube.cues(video, Track("en", "asr"))
                starts = [cue.word_start_s for cue in one.cues[video.id, "asr"]]
                assert starts == [list(cue.word_starts) for cue in said]
                compared += sum(map(len, starts))
    assert compared > 50_000


@pytest.fixture(scope="module")
def compared(worlds: list[Served]) -> list[Compared]:
    """Of each world, the keywords of the videos with both tracks."""
    return [_compared(one) for one in worlds]


def _compared(one: Served) -> Compared:
    names = [noun.name for noun in one.world.domain.speech.nouns]
    phrases = tuple(map(phrase, names))
    keywords = Keywords(
        tuple(Keyword(name, "noun") for name in names), phrases, tuple(range(len(names)))
    )
    texts = (one.text(dict.fromkeys(one.with_both_tracks, kind)) for kind in ("asr", ""))
    return compare(*texts, keywords)


def test_the_planted_error_is_inside_the_interval_of_what_is_measured(
    worlds: list[Served], compared: list[Compared]
) -> None:
    inside = []
    for one, found in zip(worlds, compared, strict=True):
        lost, swapped = one.world.truth["hearing"]["rates"].values()
        right = 1 - lost - swapped
        for share, keywords in ((right / (1 - lost), found.automatic), (right, found.manual)):
            low, high = wilson_interval(len(found.both), len(keywords))
            inside.append(low <= share <= high)
    assert sum(inside[::2]) >= 0.9 * len(SEEDS)
    assert sum(inside[1::2]) >= 0.9 * len(SEEDS)


def test_the_planted_offset_is_measured(worlds: list[Served], compared: list[Compared]) -> None:
    """A manual track shares the time of a cue out evenly among its words, so that single
    videos are measured less well.
    """
    misses = []
    for one, found in zip(worlds, compared, strict=True):
        shifts = {told["video_id"]: told["shift_s"] for told in one.world.truth["shifted"]}
        for number, video in enumerate(one.with_both_tracks):
            measured = -np.median(found.later_s[found.video == number])
            misses.append(float(measured) - shifts.get(video, 0.0))
    assert len(misses) >= 30
    assert abs(np.median(misses)) <= 0.1
    assert max(map(abs, misses)) <= 0.3
