"""The invented world is the same everywhere, covers every case, and grows."""

import hashlib
import subprocess
import sys

from kb.sandbox.world import World
from kb.sandbox.youtube.cases import CASES

STAGES = [
    "missing",
    "topic",
    "views",
    "aspect_ratio",
    "duration",
    "age_restricted",
    "toxicity",
    "transcript",
]
_DIGEST = """
import hashlib
from kb.sandbox.world import World
world = World(3).youtube
videos = world.videos.values()
held = [(video, world.cues(video, track)) for video in videos for track in video.tracks]
print(hashlib.sha256(repr(held).encode("utf-8", "surrogatepass")).hexdigest())
"""


def digest(seed: int) -> str:
    world = World(seed).youtube
    held = [
        (video, world.cues(video, track))
        for video in world.videos.values()
        for track in video.tracks
    ]
    return hashlib.sha256(repr(held).encode("utf-8", "surrogatepass")).hexdigest()


def test_a_seed_makes_the_same_world_in_every_process() -> None:
    other = subprocess.run(
        [sys.executable, "-c", _DIGEST],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONHASHSEED": "7", "PYTHONPATH": "."},
    )
    assert other.stdout.strip() == digest(3) != digest(4)


def test_every_case_and_stage_is_there() -> None:
    world = World().youtube
    assert {video.case.name for video in world.videos.values()} == {case.name for case in CASES}
    assert {case.stage for case in CASES if case.stage} == set(STAGES)
    assert {case.kind for case in CASES if not case.stage} == {"manual", "asr", "translated"}
    assert {case.evidence for case in CASES if not case.stage} == {"game_label", "keywords"}


def test_channels_of_every_kind() -> None:
    world = World().youtube
    sizes = [len(channel.videos) for channel in world.channels]
    assert sizes[:5] == [130, 50, 51, 0, 0]
    assert sum(sizes) == len(world.videos) == 300
    assert [channel.listed for channel in world.channels].count(False) == 1
    assert len(world.search("Minecraft")) == 12
    assert 0 < len(world.search("Minecraft Guide")) < 12


def test_the_world_has_any_size() -> None:
    for channels, videos in ((1, 1), (3, 60), (9, 40), (200, 1_000)):
        world = World(n_channels=channels, n_videos=videos).youtube
        assert (len(world.channels), len(world.videos)) == (channels, videos)
