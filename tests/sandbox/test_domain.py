"""Worlds made of a profile: its words in everything, the same planted cases, none of another's."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import requests

from kb.core.config.profile import load_profile
from kb.sandbox.domain import domain_of
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import CASES
from tests.faults import Sandbox
from tests.sandbox.answers import ask
from tests.sandbox.domains import GAMES, MINECRAFT, PROFILES, of_case, written
from tests.small_worlds import DEMO


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


def test_every_case_is_there_and_every_stage(world: World) -> None:
    videos = world.youtube.videos.values()
    assert {video.case.name for video in videos} == {case.name for case in CASES}
    stages = {case.stage for case in world.domain.cases}
    # Without thresholds for toxicity nothing is dropped for it.
    scored = world.domain.rules.toxicity
    assert stages - {None} == {
        "missing", "topic", "views", "aspect_ratio", "duration", "age_restricted", "transcript",
        *(["toxicity"] if scored else []),
    }  # fmt: skip


def test_videos_speak_of_the_keywords_and_pass_the_thresholds(world: World) -> None:
    rules, speech = world.domain.rules, world.domain.speech
    said = " ".join(
        cue[2] for video in of_case(world.youtube, "manual") for cue in
        world.youtube.cues(video, video.tracks[0])
    )  # fmt: skip
    said = said.lower()
    assert sum(noun.name in said for noun in speech.nouns) >= 10
    for video in of_case(world.youtube, "manual"):
        assert int(video.view_count or 0) >= rules.min_views
        assert video.seconds >= rules.min_seconds
        assert speech.topic.lower() in video.title.lower()
        assert video.tracks[0].language == rules.language
    (least,) = of_case(world.youtube, "100 views")
    assert int(least.view_count or 0) == rules.min_views


def test_every_search_finds_channels(world: World, tmp_path: Path) -> None:
    profile = load_profile(written(world.name, tmp_path))
    for words in profile.section("youtube").keywords:
        assert world.youtube.search(words), words


def test_what_is_off_topic_names_no_topic(world: World) -> None:
    topic = world.domain.speech.topic.lower()
    for video in of_case(world.youtube, "no label, topic nowhere"):
        assert topic not in f"{video.title} {video.description} {video.tags}".lower()


def test_a_profile_without_lists_or_sources_has_a_world_too(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text('name = "bare"\ntitle = "Bare Things"\n')
    world = World(domain=domain_of(load_profile(path)), **DEMO)
    text = "\n".join(served(world))
    assert "Bare Things" in text
    assert not MINECRAFT.findall(text)
