"""Invented worlds: made of a profile, its words in everything and none of another's; the same in
every process; with ids that no real service can have.
"""

import base64
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import requests

from kb.core.config.profile import load_profile
from kb.sandbox.domain import domain_of
from kb.sandbox.invented_ids import PEOPLE
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import CASES
from tests.faults import Sandbox
from tests.sandbox.domains import GAMES, MINECRAFT, PROFILES, written
from tests.small_worlds import DEMO

_DIGEST = """
import hashlib
from kb.sandbox.world import World
def digest(seed):
    world = World(seed, n_channels=9, n_videos=40).youtube
    videos = world.videos.values()
    held = [(video, world.cues(video, track)) for video in videos for track in video.tracks]
    return hashlib.sha256(repr(held).encode("utf-8", "surrogatepass")).hexdigest()
print(digest(3), digest(4))
"""


def ask(root: str, **params: str) -> dict[str, Any]:
    """The wiki's answer to a query of its API."""
    return requests.get(f"{root}/w/api.php", {"action": "query", **params}, timeout=9).json()


@pytest.fixture(scope="module", params=list(PROFILES))
def world(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> World:
    path = written(request.param, tmp_path_factory.mktemp("domain"))
    made = World(domain=domain_of(load_profile(path)), **DEMO)
    made.name = request.param
    return made


def served(world: World) -> Iterator[str]:
    """Everything that the services show, as text."""
    for channel in world.youtube.channels:
        yield f"{channel.title} {channel.description}"
    for video in world.youtube.videos.values():
        yield f"{video.title} {video.description} {video.tags} {video.label}"
        for track in video.tracks:
            for _, _, said, *_ in world.youtube.cues(video, track):
                yield said
    yield json.dumps([world.reddit.posts, world.reddit.comments, world.reddit.archive])
    with Sandbox(world, services=["wiki"]) as services:
        root = services.settings()["KB_WIKI_URL"]
        for state in ("first", "later"):
            world.wiki_state = state
            listed = ask(root, list="allpages", aplimit="50")
            titles = [one["title"] for one in listed["query"]["allpages"]]
            yield json.dumps([listed, ask(root, titles="|".join(titles), meta="siteinfo")])
            for title in titles:
                page = requests.get(f"{root}/wiki/{title}", timeout=9)
                assert page.ok, title
                yield page.text
        for name in ("common.css", "common.js", "site.css"):
            yield requests.get(f"{root}/static/{name}", timeout=9).text
    world.wiki_state = "first"


def test_nothing_of_minecraft_is_served(world: World) -> None:
    text = "\n".join(served(world))
    assert not MINECRAFT.findall(text)
    assert not GAMES.findall(text)
    assert world.domain.title in text


def test_every_search_finds_channels(world: World, tmp_path: Path) -> None:
    profile = load_profile(written(world.name, tmp_path))
    for words in profile.section("youtube").keywords:
        assert world.youtube.search(words), words


def test_a_profile_without_lists_or_sources_has_a_world_too(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text('name = "bare"\ntitle = "Bare Things"\n')
    world = World(domain=domain_of(load_profile(path)), **DEMO)
    text = "\n".join(served(world))
    assert "Bare Things" in text
    assert not MINECRAFT.findall(text)


def test_a_seed_makes_the_same_world_in_every_process() -> None:
    said = [
        subprocess.run(
            [sys.executable, "-c", _DIGEST],
            capture_output=True,
            text=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": "."},
        ).stdout.split()
        for seed in "78"
    ]
    assert said[0] == said[1]
    assert said[0][0] != said[0][1]


def test_every_case_and_stage_is_there() -> None:
    world = World().youtube
    assert {video.case.name for video in world.videos.values()} == {case.name for case in CASES}
    assert {case.kind for case in CASES if not case.stage} == {"manual", "asr", "translated"}
    assert {case.evidence for case in CASES if not case.stage} == {"game_label", "keywords"}


def test_no_id_can_exist_on_the_real_service() -> None:
    world = World(n_channels=9, n_videos=60, n_posts=30, width=40, depth=6)
    for video in world.youtube.videos.values():
        for token, size in ((video.id, 8), (video.channel.id[2:], 16)):
            whole = base64.urlsafe_b64decode(token + "=" * (-len(token) % 4))[:size]
            assert base64.urlsafe_b64encode(whole).decode().rstrip("=") != token
    reddit, (old_posts, old_comments) = world.reddit, world.reddit.archive
    keys = [*reddit.posts, *reddit.comments, *old_posts, *old_comments]
    assert len(set(keys)) == len(keys)
    assert all(int(key, 36) >= 2**63 for key in keys)
    people = {post["author"] for post in reddit.posts.values()} - {"[deleted]"}
    assert people <= set(PEOPLE)
    assert all(len(name) > 20 for name in people)
