"""What the sandbox plants in twenty worlds is found: reposts and recurring texts.

The sentences of the invented talk recur too, by chance. So what is found to recur is right where
plain counting says so, and all that is planted has to be among it.
"""

import re
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pytest

from kb.pairs import repeated_text
from kb.pairs.repeated_text import hashed_words
from kb.pairs.transcript_batch import Text
from kb.sandbox.world import World
from kb.sandbox.youtube import web
from kb.sandbox.youtube.cases import Track, Video
from kb.schema import table
from kb.youtube.ytdlp.subtitles import read
from tests.conftest import needs

needs("rensa")
SEEDS = range(20)
LENGTH, VIDEOS = 6, 3  # of a recurring run, in words and in videos of a channel


class Spoken(NamedTuple):
    """A world's kept videos with a track in English, and the transcripts that a crawl reads."""

    world: World
    videos: list[Video]
    text: Text
    words: list[list[str]]  # of each video, by plain splitting


@pytest.fixture(scope="module")
def spoken() -> list[Spoken]:
    return [_spoken(World(seed, n_channels=9, n_videos=100)) for seed in SEEDS]


def _spoken(world: World) -> Spoken:
    videos, rows = [], []
    for video in world.youtube.videos.values():
        kinds = world.youtube.planted.own_kinds(video)
        if video.case.stage is None and kinds:
            kind = min(kinds)  # a manual track before an automatic one
            cues = [cue._asdict() for cue in _read(world, video, kind)]
            names = {"start_s", "duration_s", "text"}
            cues = [{name: cue[name] for name in names} for cue in cues]
            videos.append(video)
            rows.append({"video_id": video.id, "kind": kind or "manual", "cues": cues})
    columns = {name: [row[name] for row in rows] for name in ("video_id", "kind", "cues")}
    schema = table("youtube/transcripts").arrow()
    arrays = [pa.array(columns[name], schema.field(name).type) for name in columns]
    text = Text(pa.Table.from_arrays(arrays, list(columns)))
    plain = [_plain(" ".join(cue["text"] for cue in row["cues"])) for row in rows]
    return Spoken(world, videos, text, plain)


def _read(world: World, video: Video, kind: str) -> list[Any]:
    """A track's cues as the client reads them from what the site serves."""
    return read("srv3", web.srv3(world.youtube.cues(video, Track("en", kind)))).cues


def _plain(text: str) -> list[str]:
    return re.findall(r"[^\W_]+", re.sub(r"\[\w+\]", " ", text.lower()))


def test_reposts_are_found_and_nothing_else(spoken: list[Spoken]) -> None:
    found, planted = set(), set()
    for seed, one in zip(SEEDS, spoken, strict=True):
        bands = repeated_text.bands_of(hashed_words(one.text), len(one.text))
        first = repeated_text.firsts(bands.bands)
        numbers = bands.video.tolist()
        for place, (number, of) in enumerate(zip(numbers, first.tolist(), strict=True)):
            if of != place:
                found.add((seed, frozenset((one.videos[number].id, one.videos[numbers[of]].id))))
        planted |= {(seed, frozenset(pair.values())) for pair in one.world.truth["copies"]}
    assert len(planted) >= 40
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
            for text in one.world.truth["recurring"]:
                if text["video_id"] == video.id:
                    said = _plain(text["text"])
                    (at, *_) = (n for n in range(len(words)) if words[n : n + len(said)] == said)
                    planted += len(said)
                    found_planted += sum(mark[at : at + len(said)])
    assert planted > 10_000
    assert found_planted >= 0.9 * planted
    assert right >= 0.95 * found


def _marked(one: Spoken, path: Path) -> list[list[bool]]:
    """Of each video's words, whether they lie in a run that was found to recur."""
    words = hashed_words(one.text)
    keys = repeated_text.keys_of(words, [video.channel.id for video in one.videos])
    np.save(path, repeated_text.once_a_video(keys, words.video[: len(keys)]))
    hits = np.flatnonzero(np.isin(keys, repeated_text.recurring([path]).keys) & (keys != 0))
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
