"""Titles → prompts: what is cut off, what is no task, and what the sandbox plants."""

import pytest

from kb.core.config.profile import load_profile
from kb.pairs import keywords
from kb.sandbox.domain import domain_of
from kb.sandbox.world import World
from kb.tasks.titles import TitleMiner

SEEDS = range(10)


def _miner(name: str) -> TitleMiner:
    profile = load_profile(name)
    names = [one.name for one in keywords.load(profile).every]
    return TitleMiner(profile.tasks, profile.youtube.words, names)


@pytest.fixture(scope="module")
def miner() -> TitleMiner:
    return _miner("minecraft")


@pytest.mark.parametrize(
    ("title", "prompt"),
    [
        ("How to Build an EASY Iron Farm in Minecraft! (Tutorial) #12", "build an easy iron farm"),
        ("MINECRAFT : how to build a small mansion", "build a small mansion"),
        ("In this video I show you how to make a bow | Minecraft", "make a bow"),
        ("🏰 Building a HUGE castle!! 😱", "build a huge castle"),
        ("Let's Craft a Shield - Episode 4", "craft a shield"),
        ("3. Find every ore in minecraft 1.20.4", "find every ore"),
        ("【New】Tame a Wolf [1.21] #minecraft #shorts", "tame a wolf"),
        ("Episode 7 – Build and decorate a modern house", "build and decorate a modern house"),
        ("Our world | Day 12: build a jack-o'-lantern with", "build a jack-o'-lantern"),
        ("Build a Minecraft church", "build a church"),
        ("Easy iron farm tutorial", "build easy iron farm"),
        ("Villager trading hall guide", "build villager trading hall"),
        ("EASIEST Gold Farm in Minecraft 1.21 - 10,000 per Hour!", "build easiest gold farm"),
        ("Automatic Sugar Cane Farm (Bedrock Edition)", "build automatic sugar cane farm"),
        ("Minecraft | Small survival house build | Tutorial", "build small survival house"),
        ("Bedrock how to build a creeper farm", "build a creeper farm"),
        ("Build my iron farm hardcore", "build iron farm"),
        ("Making my dream house", "make dream house"),
        ("Light house tutorial", "build light house"),
        ("Farm diamonds fast", "farm diamonds fast"),
        ("How to survive your first night", "survive your first night"),
        ("Fight the wither in survival", "fight the wither"),
        ("Finish the castle roof hardcore", "finish the castle roof"),
        ("How to reset the end dimension", "reset the end dimension"),
        ("Transforming a desert village", "transform a desert village"),
        ("How to burn zombies (mcbe)", "burn zombies"),
    ],
)
def test_a_title_gives_the_prompt_alone(miner: TitleMiner, title: str, prompt: str) -> None:
    assert miner.mine(title)[::2] == (prompt, ())


@pytest.mark.parametrize(
    ("title", "reasons"),
    [
        ("I spent 5 days with gravel", ("no_verb",)),
        ("Top 10 things to build", ("no_verb",)),
        ("Crafting Table and Axolotl", ("no_verb",)),
        ("مرحبا Minecraft", ("no_verb",)),
        ("", ("no_verb",)),
        ("Minecraft: building!", ("no_object", "no_verb")),
        ("Build Battle #3", ("not_a_task",)),
        ("Killing my best friend", ("not_a_task",)),
        ("Farm planning", ("no_verb",)),
        ("Farm finished and fixed", ("no_verb",)),
        ("create 5", ("no_verb",)),
        ("Light armor", ("not_a_task",)),
        ("Open world survival", ("no_verb",)),
        ("The iron farm", ("no_verb",)),
        ("I broke the iron farm | Tutorial", ("no_verb",)),
        ("Top 5 farm designs", ("no_verb",)),
        ("Iron farm tour", ("no_verb",)),
        ("I built a house for 100 days", ("not_a_task",)),
        (
            "Build a house with two floors and a yard and a pool and a tower and a wall",
            ("too_long",),
        ),
    ],
)
def test_a_title_without_a_task_has_reasons(
    miner: TitleMiner, title: str, reasons: tuple[str, ...]
) -> None:
    assert miner.mine(title).reasons == reasons


def test_what_the_prompt_is_about_ends_at_a_joint(miner: TitleMiner) -> None:
    assert miner.mine("Build the best iron farm under water").object == ("best", "iron", "farm")
    assert miner.mine("Build and decorate a modern house").object == ("modern", "house")


def test_articles_do_not_tell_prompts_apart(miner: TitleMiner) -> None:
    assert miner.plain("build a tiny house") == miner.plain("build the tiny house")


@pytest.mark.parametrize("name", ["minecraft", "cooking"])
def test_planted_titles_are_found_and_no_others(name: str) -> None:
    """At least 95 % of the planted tasks with their prompt, and at most 2 % others; the titles
    around them have the same verbs. In the game's domain some name a thing and no verb.
    """
    miner, domain = _miner(name), domain_of(load_profile(name))
    planted = right = wrong = things = 0
    for seed in SEEDS:
        world = World(seed, n_channels=9, n_videos=150, domain=domain)
        for video in world.youtube.videos.values():
            mined = miner.mine(video.title)
            found = "" if mined.reasons else mined.prompt
            planted += bool(video.task)
            things += bool(video.task) and video.task.split()[-1] in domain.speech.things
            right += bool(found) and found == video.task
            wrong += bool(found) and found != video.task
    assert planted > 200
    assert things > 100 or not domain.speech.things
    assert right >= 0.95 * planted
    assert wrong <= 0.02 * (right + wrong)
