"""Films of the invented videos: found by `kb clips`, as long as their videos, with a shape for each
keyword that is spoken.
"""

from pathlib import Path

import numpy as np
import pytest

from kb.clips.film_lookup import find_films
from kb.clips.frames import frames_at
from kb.core import installation
from kb.core.errors import MissingExtra
from kb.sandbox.world import World
from kb.sandbox.youtube.captions import spoken_words
from kb.sandbox.youtube.cases import Video
from kb.sandbox.youtube.films import AROUND_S, HEIGHT, WIDTH, look_of, write_films
from tests.conftest import needs

needs("av")

SIZE = {"n_channels": 2, "n_videos": 6}


@pytest.fixture(scope="module")
def world() -> World:
    return World(3, **SIZE)


@pytest.fixture(scope="module")
def folder(world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("films")
    assert write_films(world, made) == SIZE["n_videos"]
    return made


def shows(image: np.ndarray, keyword: str) -> bool:
    """Whether a good part of the picture has the keyword's colour."""
    apart = np.abs(image.astype(int) - look_of(keyword)[0]).max(axis=-1)
    return (apart < 30).sum() > 1_000


def named(world: World, video: Video) -> dict[str, list[float]]:
    """When the first word of each name is spoken, read from the sentences alone."""
    times: dict[str, list[float]] = {}
    for sentence in world.youtube.talk(video, "en"):
        words = spoken_words(sentence)
        text = [word.text for word in words]
        for noun in world.domain.speech.nouns:
            name = noun.name.split()
            for at in range(len(words)):
                if text[at : at + len(name)] == name:
                    times.setdefault(noun.title, []).append(words[at].start)
    return times


def test_kb_clips_finds_a_film_as_long_as_each_video(world: World, folder: Path) -> None:
    videos = world.youtube.videos
    files = find_films([folder], {key: video.seconds for key, video in videos.items()}).films
    assert files.keys() == videos.keys()
    for key, video in videos.items():
        shown = list(frames_at(files[key], [0.0, video.seconds - 0.01, video.seconds + 0.01]))
        assert len(shown) == 2, "the second time is in the film, the third one is not"


def test_a_shape_is_shown_while_its_keyword_is_spoken_and_not_elsewhere(
    world: World, folder: Path
) -> None:
    checked = 0
    for key, video in world.youtube.videos.items():
        times = named(world, video)
        spoken = sorted(times, key=lambda one: times[one][0])
        for keyword in spoken[:6]:
            start_s = times[keyword][0]
            # A name may be part of a longer one, which has the shape then.
            if any(keyword != one and start_s in times[one] for one in times):
                continue
            (image,) = frames_at(folder / f"{key}.mp4", [start_s], (HEIGHT, WIDTH))
            assert shows(image, keyword), (keyword, start_s)
            checked += 1
        everywhere = sorted(start for starts in times.values() for start in starts)
        (first,) = frames_at(folder / f"{key}.mp4", [0.0], (HEIGHT, WIDTH))
        if everywhere and everywhere[0] > AROUND_S + 1:
            assert np.ptp(first.astype(int)) < 10, "an empty picture"
    assert checked > 15


def test_without_pyav_the_extra_is_named_and_nothing_is_written(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "find_spec", lambda name: None if name == "av" else object())
    with pytest.raises(MissingExtra, match="av is not installed") as caught:
        write_films(world, tmp_path / "films")
    assert '".[clips]"' in caught.value.hint
    assert not (tmp_path / "films").exists()
