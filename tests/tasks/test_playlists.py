"""Tasks of videos that playlists list: against what the sandbox plants."""

import json
from collections.abc import Iterator

import pytest

from kb.core.config.profile import load_profile
from kb.sandbox.world import World
from kb.tasks.titles import TitleMiner
from tests.faults import Sandbox
from tests.youtube.job import Job, searched_playlists


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    with Sandbox(World(n_channels=9, n_videos=150), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("tasks"))
        job.done("youtube", "crawl")
        job.done("youtube", "filter")
        yield job


def test_tasks_from_playlists_are_those_that_a_playlist_lists(job: Job) -> None:
    job.done("tasks")
    every = {row["video_id"]: row for row in job.rows("SELECT * FROM clean.tasks")}
    places: dict[str, dict[str, int]] = {}
    for one in sorted(searched_playlists(job.sandbox), key=lambda one: one.id):
        if one.privacy == "public":
            for place, video in enumerate(one.entries):
                places.setdefault(video.id, {}).setdefault(one.id, place)
    for key, row in every.items():
        of_video = places.get(key, {})
        first = min(of_video, default=None)
        assert (row["playlist_id"], row["playlist_position"]) == (first, of_video.get(first or ""))

    job.profile(("\nverbs = [", '\nfrom = "playlists"\nverbs = ['))
    made = job.done("tasks")
    listed = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.tasks")}
    assert listed == {key for key in every if key in places}
    assert made["from_playlists"] == made["tasks"] == len(listed)
    reasons = (
        "SELECT video_id, reasons FROM clean.tasks_titles WHERE rejected_reason = 'no_playlist'"
    )
    assert {row["video_id"] for row in job.rows(reasons)} >= every.keys() - places.keys()
    planted = {one["video_id"]: one["prompt"] for one in job.sandbox.world.truth["tasks"]}
    assert len(listed - planted.keys()) <= 1


def test_minedojos_tutorials_are_those_of_playlists(job: Job) -> None:
    job.done("youtube", "export", "--format", "minedojo")
    folder = job.root / "export" / "minedojo"
    tutorials = {one["id"] for one in json.loads((folder / "youtube_tutorial.json").read_text())}
    every = {one["id"] for one in json.loads((folder / "youtube_full.json").read_text())}
    listed = {
        video.id
        for one in searched_playlists(job.sandbox)
        if one.privacy == "public"
        for video in one.entries
    }
    assert tutorials == every & listed


def test_a_thing_without_a_verb_is_a_task_where_a_playlist_teaches() -> None:
    miner = TitleMiner(load_profile("minecraft").tasks, ["Minecraft"])
    for title in ("Iron Farm", "Minecraft Villager Trading Hall", "Underwater House"):
        assert miner.mine(title).reasons
        assert not miner.mine(title, taught=True).reasons, title
    for title in ("Iron Farm Tour vs Yours", "Relaxing Music", "House"):
        assert miner.mine(title, taught=True).reasons, title
